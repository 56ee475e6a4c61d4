"""Where photos have skies of their own, another sky is nothing in the way; things before it are."""

from dataclasses import replace

import pytest
import torch

from desplat_ns.core.effects import BackgroundGrade
from tests.helpers.well_known_scene import HEIGHT, WIDTH, WellKnownScene

SKY = (slice(0, HEIGHT // 2), slice(0, WIDTH))
"""The upper half, in which the scene has no Gaussians."""


def smooth(blue: float) -> torch.Tensor:
    """A sky that gets brighter downwards."""
    sky = torch.tensor([0.5, 0.6, blue]).expand(HEIGHT, WIDTH, 3).clone()
    return sky + torch.linspace(0, 0.2, HEIGHT)[:, None, None]


class SceneBelowASky(WellKnownScene):
    """Blocks in the lower half; the other photos' sky above them is blue."""

    def __init__(self) -> None:
        super().__init__()
        self.photo[SKY] = smooth(0.8)[SKY]
        alpha = torch.ones(HEIGHT, WIDTH, 1)
        alpha[SKY] = 0.0
        self.drawn = replace(self.drawn, alpha=alpha)
        self.opacities.view(HEIGHT, WIDTH)[SKY] = -20.0

    def regions(self, photo: torch.Tensor, background: BackgroundGrade) -> torch.Tensor:
        """Of a photo, once ten like the scene were seen."""
        for _ in range(10):
            self.find(self.photo, background=background)
        return self.find(photo, background=background)


@pytest.fixture
def grey_sky() -> torch.Tensor:
    photo = SceneBelowASky().photo
    photo[SKY] = smooth(0.4)[SKY]
    return photo


def test_another_sky_is_in_the_way_only_where_photos_share_theirs(grey_sky):
    assert SceneBelowASky().regions(grey_sky, background="off")[: HEIGHT // 2 - 4].all()
    assert not SceneBelowASky().regions(grey_sky, background="image").any()


def test_what_stands_before_the_sky_is_found(grey_sky):
    """Dark stripes, four pixels wide, on the right."""
    grey_sky[: HEIGHT // 2, 40:].view(HEIGHT // 2, -1, 2, 5, 3)[:, :, 0] = 0.05
    regions = SceneBelowASky().regions(grey_sky, background="image")
    assert regions[4 : HEIGHT // 2 - 4, 44 : WIDTH - 4].all()
    assert not regions[:, :30].any()


def test_what_stands_before_the_scene_is_found_under_another_sky(grey_sky):
    grey_sky[24:36, 10:30] = torch.tensor([0.9, 0.1, 0.9])
    regions = SceneBelowASky().regions(grey_sky, background="image")
    assert regions[26:34, 12:28].all()
    assert not regions[: HEIGHT // 2 - 4].any()
