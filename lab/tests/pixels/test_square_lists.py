from __future__ import annotations

import torch

from desplat_ns.calibration.scenes import make_scene
from lab.pixels.contenders import contender_called
from lab.pixels.dial_errors import Drawing
from lab.pixels.dials import TODAY, Setting

SCENE = make_scene(400, 70, 45)
SQUARES = Setting(lists="squares")


def drawn(name: str, setting: Setting, scene=SCENE):
    return Drawing(contender_called(name), scene, setting, scene.splats).drawn()


def test_compiled_and_plain_squares_show_the_same_with_the_same_gradients():
    """Float32 rounds at 6e-8; 60 Gaussians blend in a pixel, 10 operations each."""
    plain, compiled = (drawn(name, SQUARES) for name in ("torch", "numba"))
    assert (plain.picture - compiled.picture).abs().max() < 60 * 10 * 6e-8
    for name, wanted in plain.gradients.items():
        off = (compiled.gradients[name] - wanted).norm() / wanted.norm()
        assert off < 60 * 10 * 6e-8 * 10, name


def test_on_squares_only_what_lies_beyond_3_sigma_is_missing():
    """An opaque Gaussian still has exp(-4.5) = 0.011 there; a faint one is below the cutoff."""
    missing = drawn("numba", TODAY).picture - drawn("numba", SQUARES).picture
    assert missing.abs().max() > 0
    faint = make_scene(400, 70, 45)
    faint.params["opacities"].clamp_(max=-1.0)  # at most 0.27, 0.27 exp(-4.5) = 0.003 < 1 / 255
    assert torch.equal(drawn("numba", TODAY, faint).picture, drawn("numba", SQUARES, faint).picture)


def test_squares_of_nothing_are_empty():
    scene = make_scene(3, 20, 20)
    scene.params["opacities"].fill_(-20.0)
    for name in ("torch", "numba"):
        assert drawn(name, SQUARES, scene).picture.abs().max() == 0
