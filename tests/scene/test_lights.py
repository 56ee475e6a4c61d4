"""Which of the photos' lights a page has, and in which colours."""

import numpy as np
import pytest
import torch

from desplat_ns.backend.protocol import View
from desplat_ns.console import text_of
from desplat_ns.export.baked import baked
from desplat_ns.rendering.views import view_of
from desplat_ns.scene.contents import AVERAGE
from desplat_ns.scene.lights import light_of, other_lights, standing_for_all
from tests.helpers.relit_model import held_out, model_with, moved


def on_a_line(*places: float) -> torch.Tensor:
    return torch.tensor(places)[:, None]


@pytest.fixture()
def view() -> View:
    return view_of(held_out())


def test_lights_are_taken_that_all_are_nearest_to():
    """Around 0 is the first one. Of those about 10 the middle one serves all three best, and then
    the one at -4 is farther from what is taken than any other."""
    lights = on_a_line(0.1, 9.0, 10.0, 11.0, -4.0, 0.2)
    assert standing_for_all(lights, torch.zeros(1), 2) == [2, 4]


def test_lights_that_are_all_the_same_are_not_repeated():
    assert standing_for_all(on_a_line(3.0, 3.0, 3.0), torch.tensor([3.0]), 3) == []
    assert standing_for_all(on_a_line(3.0, 3.0, 5.0), torch.tensor([3.0]), 3) == [2]
    many = torch.rand(1500, generator=torch.Generator().manual_seed(0)).expand(40, 1500)
    assert len(standing_for_all(many, torch.zeros(1500), 3)) == 1


def test_a_single_strange_light_is_not_taken_first():
    lights = on_a_line(*[0.0] * 10, *[5.0] * 10, 20.0)
    assert 10 <= standing_for_all(lights, torch.zeros(1), 1)[0] < 20


@pytest.mark.slow
@pytest.mark.parametrize("appearance", ["affine", "sh"])
def test_each_light_has_the_colours_that_are_baked_for_its_photo(appearance: str, view: View):
    model = moved(model_with(appearance)).eval()
    model.names = [f"photo {i}.jpg" for i in range(model.num_train_data)]
    model.names[0] += "\udcfc"  # a byte that is no text
    rows = torch.arange(model.num_points) % 3 != 0
    lights = other_lights(model, rows, view)
    assert 1 <= len(lights) <= 3 and len({light.name for light in lights}) == len(lights)
    for light in lights:
        photo = [text_of(name) for name in model.names].index(light.name)
        with model.shown_in(model.image_effects.of(photo)):
            whole = baked(model.shown_splats().rows(rows), antialiased=False)
        assert np.allclose(light.harmonics, whole.harmonics, atol=1e-5)
    again = other_lights(model, rows, view)
    assert [light.name for light in again] == [light.name for light in lights]


@pytest.mark.slow
def test_there_is_nothing_to_choose_where_all_photos_have_the_same_light(view: View):
    model = model_with("off", "constant").eval()
    assert other_lights(model, torch.ones(model.num_points, dtype=torch.bool), view) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("appearance", "asked", "expected"),
    [
        ("off", None, ""),
        ("camera", None, AVERAGE),
        ("affine", None, AVERAGE),
        ("sh", "a.jpg", "a.jpg"),
        ("sh", "gr\udcfcn.jpg", "gr\\xfcn.jpg"),
    ],
)
def test_a_page_tells_whose_light_it_shows_where_photos_differ(
    appearance: str, asked: str | None, expected: str
):
    assert light_of(model_with(appearance).eval(), asked) == expected
