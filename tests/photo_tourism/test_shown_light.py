"""Whose light is shown: an evaluation's, the viewer's, the environment's, its own, the mean."""

import pytest
import torch

from desplat_ns.core.effects import Effects
from desplat_ns.core.errors import ConfigError
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.photo_tourism.shown_light import VARIABLE, ShownLight

NAMES = ["a.jpg", "b:1.jpg", "c.jpg"]


@pytest.fixture
def lights() -> ImageEffects:
    torch.manual_seed(0)
    return ImageEffects(Effects(appearance="affine"), AppearanceConfig(), 3, 3)


def test_an_image_of_its_own_else_the_average(lights):
    shown = ShownLight(NAMES)
    assert torch.equal(shown.embedding(lights, 1), lights.of(1))
    torch.testing.assert_close(shown.embedding(lights), lights.of(None))


def test_the_environment_names_an_image_and_the_viewers_choice_comes_before_it(lights, monkeypatch):
    monkeypatch.setenv(VARIABLE, "b:1.jpg")
    shown = ShownLight(NAMES)
    assert torch.equal(shown.embedding(lights), lights.of(1))
    shown.choice.value = "c.jpg"
    for train_index in (None, 1):
        assert torch.equal(shown.embedding(lights, train_index), lights.of(2))


def test_an_evaluation_sees_neither(lights, monkeypatch):
    monkeypatch.setenv(VARIABLE, "a.jpg")
    shown = ShownLight(NAMES)
    with shown.suspended():
        torch.testing.assert_close(shown.embedding(lights), lights.of(None))
        with shown.fixed(torch.ones(32)):
            assert torch.equal(shown.embedding(lights), torch.ones(32))
    torch.testing.assert_close(shown.embedding(lights), lights.of(0))


def test_a_name_of_another_scene_matters_only_where_it_is_worn(lights, monkeypatch):
    monkeypatch.setenv(VARIABLE, "elsewhere.jpg")
    shown = ShownLight(NAMES)
    with shown.suspended():
        shown.embedding(lights)
    with pytest.raises(ConfigError, match=r"elsewhere\.jpg"):
        shown.embedding(lights)
