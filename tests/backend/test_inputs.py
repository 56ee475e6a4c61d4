import math
import re

import pytest
import torch

from desplat_ns.backend import RenderSettings, resolve
from tests.backend.scenes import TestScene, random_scene

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
    ({"opacities": torch.ones(2, 1)}, "opacities"),
    ({"scales": torch.ones(1, 3)}, "scales"),
    ({"viewmat": torch.eye(3)}, "viewmat"),
    ({"colors": torch.ones(2, 4, 3)}, "sh_degree"),
    ({"colors": torch.ones(2, 4, 3), "sh_degree": 2}, "K >= 9"),
    ({"scales": torch.ones(2, 3).double()}, "scales is torch.float64"),
    ({"K": torch.eye(3, device="meta")}, "K is on meta"),
    ({"size": (0, 4)}, "0 x 4"),
]


@pytest.mark.usefixtures("unchecked_types")  # jaxtyping would speak first
@pytest.mark.parametrize(("change", "said"), WRONG)
def test_a_tensor_that_does_not_fit_is_named(change, said):
    scene = TestScene(**{**GOOD, **change})
    with pytest.raises(ValueError, match=re.escape(said)):
        resolve("torch")(scene.splats, scene.view, RenderSettings())


BAD_CAMERAS = [
    ("K", (0, 0), 0.0),
    ("K", (1, 1), -16.0),
    ("K", (1, 2), 1e30),
    ("viewmat", (0, 3), math.nan),
    ("viewmat", (1, 1), 2e19),
]


@pytest.mark.parametrize("name", ["torch", "numba"])
@pytest.mark.parametrize(("matrix", "place", "value"), BAD_CAMERAS)
def test_a_camera_that_cannot_be_is_named(name, matrix, place, value):
    scene = random_scene(1, count=3).to(torch.float64)
    getattr(scene, matrix)[place] = value
    with pytest.raises(ValueError, match="No camera has"):
        resolve(name, "cpu")(scene.splats, scene.view, RenderSettings())
