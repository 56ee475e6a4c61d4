from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from desplat_ns.backend import blending, numba_tiles, projection, tile_lists, torch_tiles
from desplat_ns.calibration.scenes import make_scene
from lab.pixels.contenders import Contender, contender_called
from lab.pixels.dial_errors import Drawing, Drawn, errors_of
from lab.pixels.dials import (
    ANTIALIASED,
    DIALS,
    EXACT,
    TODAY,
    Setting,
    replacements,
    turned,
    unavailable_reason,
)

SCENE = make_scene(300, 64, 48)
BACKENDS = ("numba", "torch")

ROUNDING = 60 * 10 * 6e-8
"""Float32 rounds at 6e-8; 60 Gaussians blend in a pixel, 10 operations each."""


def drawn(name: str, setting: Setting) -> Drawn:
    return Drawing(contender_called(name), SCENE, setting, SCENE.splats).drawn()


def globals_now() -> list[object]:
    return [
        projection.REACH_SIGMAS,
        blending.ALPHA_CUTOFF,
        blending.TRANSMITTANCE_MIN,
        tile_lists.ALPHA_CUTOFF,
        torch_tiles.TRANSMITTANCE_MIN,
        torch_tiles.tile_lists,
        numba_tiles.ALPHA_CUTOFF,
        numba_tiles._LIMITS,
        numba_tiles.tile_lists,
    ]


@pytest.fixture(scope="module")
def truth() -> Drawn:
    return drawn("torch", EXACT)


@pytest.mark.parametrize("name", BACKENDS)
def test_limits_are_as_they_were_afterwards_also_after_an_exception(name):
    before = globals_now()
    changes = replacements(contender_called(name), Setting(lists="squares", cutoff=0.1, stop=0.1))
    with pytest.raises(ZeroDivisionError), turned(changes):
        assert sum(a is not b for a, b in zip(before, globals_now(), strict=True)) == len(changes)
        raise ZeroDivisionError
    assert all(a is b for a, b in zip(before, globals_now(), strict=True))


@pytest.mark.parametrize("name", BACKENDS)
def test_todays_setting_is_what_the_backend_draws_by_itself(name):
    contender = contender_called(name)
    drawing = Drawing(contender, SCENE, TODAY, SCENE.splats)
    by_itself = contender.rasterizer(drawing.splats, SCENE.view, drawing.settings)
    assert torch.equal(drawn(name, TODAY).picture, by_itself.rgb.detach().double())


@pytest.mark.parametrize("name", BACKENDS)
def test_a_lower_cutoff_is_nearer_to_the_truth_in_picture_and_gradients(name, truth):
    cutoffs = (1 / 32, 1 / 255, 1 / 2048)
    errors = [errors_of(drawn(name, Setting(cutoff=cutoff)), truth) for cutoff in cutoffs]
    assert errors[0].picture > errors[1].picture > errors[2].picture
    assert errors[0].gradient > errors[1].gradient > errors[2].gradient


@pytest.mark.parametrize("name", BACKENDS)
def test_an_earlier_stop_is_farther_from_the_truth(name, truth):
    late, early = (errors_of(drawn(name, Setting(stop=stop)), truth) for stop in (1e-4, 1e-2))
    assert late.picture < early.picture and late.gradient < early.gradient


@pytest.mark.parametrize("name", BACKENDS)
def test_without_limits_only_float32_is_between_a_backend_and_the_truth(name, truth):
    rendering = drawn(name, Setting(cutoff=EXACT.cutoff, stop=EXACT.stop))
    assert (rendering.picture - truth.picture).abs().max() < ROUNDING
    assert errors_of(rendering, truth).gradient < 10 * ROUNDING


@pytest.mark.parametrize("name", BACKENDS)
def test_with_a_lower_cutoff_more_reach_into_the_picture_from_outside(name):
    """The picture is moved aside by half its width: many Gaussians lie at any distance from it."""
    contender, K = contender_called(name), SCENE.view.K.clone()
    K[0, 2] -= SCENE.view.width / 2
    drawing = Drawing(contender, SCENE, TODAY, SCENE.splats)

    def number(setting: Setting) -> int:
        with turned(replacements(contender, setting)):
            view = replace(SCENE.view, K=K)
            return int(contender.rasterizer(drawing.splats, view, drawing.settings).visible.sum())

    assert number(Setting(cutoff=EXACT.cutoff)) > number(TODAY)


def test_a_higher_degree_of_harmonics_is_nearer_to_all_of_them(truth):
    errors = [errors_of(drawn("numba", Setting(sh_degree=d)), truth).picture for d in range(4)]
    assert errors == sorted(errors, reverse=True) and len(set(errors)) == 4


def test_coefficients_that_are_not_evaluated_get_no_gradient():
    assert drawn("numba", Setting(sh_degree=1)).gradients["colors"][:, 4:].abs().max() == 0


def test_more_pixels_are_nearer_to_the_full_size(truth):
    errors = [errors_of(drawn("numba", Setting(scale=s)), truth).picture for s in (0.25, 0.5, 1.0)]
    assert errors == sorted(errors, reverse=True)


def test_every_dial_is_away_from_today_and_no_two_are_the_same():
    settings = [position.setting for position in (*DIALS, ANTIALIASED)]
    assert TODAY not in settings and len(set(settings)) == len(settings)


def test_a_backend_says_what_it_cannot_be_set_to():
    numba, torch_ = map(contender_called, BACKENDS)
    assert "float32" in str(unavailable_reason(numba, Setting(torch.float64)))
    assert unavailable_reason(torch_, Setting(torch.float64)) is None
    other = Contender("gsplat", "cuda", numba.rasterizer)
    assert "compiled in" in str(unavailable_reason(other, Setting(cutoff=0.1)))
    assert unavailable_reason(other, Setting(sh_degree=0)) is None
    assert replacements(other, TODAY) == []
