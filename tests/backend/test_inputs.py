from __future__ import annotations

import math
import re

import jaxtyping
import pytest
import torch

from desplat_ns.backend import RenderSettings, Splats, resolve
from desplat_ns.backend.inputs import check_inputs, is_finite
from tests.backend.scenes import PARAMETERS, TestScene, random_scene

GOOD = {
    "means": torch.ones(2, 3),
    "quats": torch.ones(2, 4),
    "scales": torch.ones(2, 3),
    "opacities": torch.ones(2),
    "colors": torch.ones(2, 3),
    "viewmat": torch.eye(4),
    "K": torch.eye(3),
    "size": (4, 4),
}
WRONG = [
    ({"quats": torch.ones(2, 3)}, "quats has shape (2, 3); needed is (2, 4)"),
    ({"opacities": torch.ones(2, 1)}, "opacities has shape (2, 1); needed is (2,)"),
    ({"scales": torch.ones(1, 3)}, "scales has shape (1, 3); needed is (2, 3)"),
    ({"viewmat": torch.eye(3)}, "viewmat has shape (3, 3); needed is (4, 4)"),
    ({"colors": torch.ones(2, 4, 3)}, "needed is (2, C), or (2, K, 3) with sh_degree set"),
    ({"colors": torch.ones(2, 4, 3), "sh_degree": 2}, "needs (2, K, 3) with K >= 9"),
    ({"colors": torch.ones(2, 4, 3), "sh_degree": 5}, "degrees 0 to 4 exist"),
    ({"scales": torch.ones(2, 3).double()}, "scales is torch.float64 and means is torch.float32"),
    ({"means": torch.ones(2, 3).int()}, "must have one floating-point dtype"),
    ({"K": torch.eye(3, device="meta")}, "K is on meta, means on cpu"),
    ({"size": (0, 4)}, "The image is 0 x 4"),
]


@pytest.fixture
def _unchecked_types():
    """As outside of tests, where jaxtyping does not speak first."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.usefixtures("_unchecked_types")
@pytest.mark.parametrize(("change", "said"), WRONG)
def test_a_tensor_that_does_not_fit_is_named(change, said):
    scene = TestScene(**{**GOOD, **change})
    with pytest.raises(ValueError, match=re.escape(said)):
        resolve("torch")(scene.splats, scene.view, RenderSettings())


def test_jaxtyping_rejects_a_wrong_shape_in_tests():
    with pytest.raises(TypeError):
        Splats(
            torch.ones(2, 3), torch.ones(2, 3), torch.ones(2, 3), torch.ones(2), torch.ones(2, 3)
        )


def test_fitting_inputs_pass():
    for degree in (None, 0, 4):
        scene = random_scene(1, count=3, sh_degree=degree).to(torch.float64)
        check_inputs(scene.splats, scene.view)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", PARAMETERS)
def test_a_value_that_is_not_finite_makes_its_gaussian_unsound(name, value):
    scene = random_scene(1, count=3, sh_degree=1).to(torch.float32)
    with torch.no_grad():
        getattr(scene, name).view(3, -1)[1, -1] = value
    assert is_finite(scene.splats).tolist() == [True, False, True]


def test_large_colours_are_sound_as_long_as_their_squares_are_finite():
    scene = random_scene(1, count=3).to(torch.float32)
    with torch.no_grad():
        scene.colors[:, 0] = torch.tensor([1e18, -1e19, 3e19])
    assert is_finite(scene.splats).tolist() == [True, True, False]


@pytest.mark.parametrize("name", ["torch", "numba"])
@pytest.mark.parametrize("color", [3e38, -1e38, 2e19, 1e18])
def test_colours_that_no_gradient_can_carry_are_culled(name, color):
    """Three of 1e38 add up to infinity, and infinity minus infinity is NaN."""
    scene = random_scene(1, count=20).to(torch.float32)
    with torch.no_grad():
        scene.colors[0] = color
        scene.opacities[0] = 0.9
    got = resolve(name, "cpu")(scene.splats, scene.view, RenderSettings())
    got.rgb.sum().backward()
    assert got.rgb.isfinite().all()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in scene.parameters)
    assert (got.radii[0].item() == 0) == (abs(color) > 1.9e19)


BAD_CAMERAS = [
    ("K", (0, 0), 0.0, "K[0, 0] is 0.0; a focal length is 1e-12 pixels at least"),
    ("K", (1, 1), -16.0, "K[1, 1] is -16.0; a focal length is 1e-12 pixels at least"),
    ("K", (0, 2), math.nan, "K[0, 2] is nan"),
    ("K", (1, 2), 1e30, "K[1, 2] is 1e+30"),
    ("K", (0, 0), math.inf, "K[0, 0] is inf"),
    ("viewmat", (0, 3), math.nan, "viewmat[0, 3] is nan"),
    ("viewmat", (2, 3), -math.inf, "viewmat[2, 3] is -inf"),
    ("viewmat", (1, 1), 2e19, "viewmat[1, 1] is 2e+19"),
]


@pytest.mark.parametrize("name", ["torch", "numba"])
@pytest.mark.parametrize(("matrix", "place", "value", "said"), BAD_CAMERAS)
def test_a_camera_that_cannot_be_is_named(name, matrix, place, value, said):
    scene = random_scene(1, count=3).to(torch.float64)
    getattr(scene, matrix)[place] = value
    with pytest.raises(ValueError, match=re.escape(said)):
        resolve(name, "cpu")(scene.splats, scene.view, RenderSettings())
