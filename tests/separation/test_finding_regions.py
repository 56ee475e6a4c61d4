"""What of a photo is in the way: regions by residual, other photos, detail and memory."""

import torch

from desplat_ns.separation.decide import Thresholds
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS
from tests.helpers.well_known_scene import HEIGHT, WIDTH, WellKnownScene


def seen_often() -> WellKnownScene:
    """The scene after five visits, in which nothing was in the way."""
    scene = WellKnownScene()
    for _ in range(5):
        assert not scene.find(scene.photo).any()
    return scene


def test_an_occluder_of_one_view_is_found_on_a_scene_seen_often():
    scene = seen_often()
    region = scene.find(scene.with_an_occluder())
    assert region.shape == (HEIGHT, WIDTH)
    true = torch.zeros_like(region)
    true[10:30, 20:40] = True
    assert (region & true).sum() / (region | true).sum() > 0.7


def test_a_strong_excess_above_the_most_of_a_rough_scene_acts():
    found = []
    for strong in (0.4, 0.6):
        scene = seen_often()
        photo = scene.photo.clone()
        photo[10:30, 20:40] += 0.55
        by = Thresholds(strong=strong)
        found.append(int(scene.find(photo, by).sum()))
    assert found[0] > 100 and found[1] == 0


def test_what_a_masked_pixel_holds_changes_no_bit():
    """Neither of the regions nor of what is remembered."""
    results = []
    for value in (0.0, float("nan")):
        scene, mask = WellKnownScene(), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
        mask[15:33, 12:31] = False
        for _ in range(3):
            scene.find(scene.photo)
        photo = scene.with_an_occluder().masked_fill(~mask, value)
        regions = scene.find(photo, mask=mask)
        results.append((regions, scene.state[RESIDUAL_MEDIANS]))
    assert results[0][0].any()
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])


def test_what_is_in_the_way_beside_a_mask_is_found():
    """A mask over one half of an occluder; the rim of a cell or two may go to the static scene."""
    scene, mask = WellKnownScene(), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, 30:] = False
    for _ in range(5):
        scene.find(scene.photo, mask=mask)
    region = scene.find(scene.with_an_occluder(), mask=mask)
    assert region[12:28, 22:28].all()
    assert not region[:, 30:].any()


def with_an_occluder(unexplained: torch.Tensor | None) -> torch.Tensor:
    """Regions of a photo with an occluder, if the others leave so much of the photo unexplained."""
    scene = seen_often()
    return scene.find(scene.with_an_occluder(), unexplained=unexplained)


def test_what_other_photos_explain_is_in_no_region():
    everything = torch.full((HEIGHT, WIDTH), 0.5)
    assert with_an_occluder(everything)[12:28, 22:38].all()
    assert with_an_occluder(everything[::2, ::2])[12:28, 22:38].all()  # on a grid of its own
    assert not with_an_occluder(torch.zeros(HEIGHT, WIDTH)).any()
    upper = everything.clone()
    upper[20:] = 0.0
    region = with_an_occluder(upper)
    assert region[12:18, 22:38].all()
    assert not region[27:].any()  # but for what has the colours of the upper half beside it


def test_what_nobody_knows_makes_no_region_and_joins_one():
    unknown = torch.full((HEIGHT, WIDTH), torch.nan)
    assert not with_an_occluder(unknown).any()
    upper, upper_alone = unknown, torch.zeros(HEIGHT, WIDTH)
    upper[:20] = upper_alone[:20] = 0.5
    assert with_an_occluder(upper)[12:28, 22:38].all()
    assert not with_an_occluder(upper_alone)[27:].any()


def test_what_stands_out_at_a_later_visit_founds_a_region_only_if_others_differ_much():
    """By more than they have to at first; what was in a region before stays in it."""
    no_region = torch.zeros(HEIGHT // 2, WIDTH // 2, dtype=torch.bool)
    region = no_region.clone()
    region[5:15, 10:20] = True
    for earlier, difference, is_found in (
        (None, 0.15, True),
        (no_region, 0.15, False),
        (no_region, 0.25, True),
        (region, 0.15, True),
    ):
        scene, unexplained = seen_often(), torch.full((HEIGHT, WIDTH), difference)
        found = scene.find(scene.with_an_occluder(), unexplained=unexplained, earlier=earlier)
        assert found[12:28, 22:38].all() == found.any() == is_found


def test_of_the_scenes_own_detail_in_another_light_hardly_any_is_in_a_region():
    scene = seen_often()
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    flare = 0.4 * torch.exp(-((x - 30) ** 2 + (y - 20) ** 2) / 200)[..., None]
    taken = scene.find(scene.photo + flare, Thresholds(shared_detail=1.0, strong_share=0.0)).sum()
    assert taken > 800
    assert scene.find(scene.photo + flare).sum() < 0.1 * taken
    assert scene.find(scene.with_an_occluder())[12:28, 22:38].all()
