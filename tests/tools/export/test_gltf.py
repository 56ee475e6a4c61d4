"""glTF read back by a reader written from the specification, and by trimesh."""

import io
from typing import Any

import numpy as np
import pytest
import trimesh

from desplat_ns.tools.export.gltf import glb_bytes
from tests.helpers.splat_files import cloud, read_glb

PREFIX = "KHR_gaussian_splatting:"


@pytest.mark.parametrize("degree", [0, 3])
def test_every_value_comes_back_exactly(degree: int):
    written = cloud(degree=degree)
    _, values = read_glb(glb_bytes(written))
    assert np.array_equal(values["POSITION"], written.means.astype(np.float32))
    x, y, z, w = values[f"{PREFIX}ROTATION"].T
    assert np.array_equal(np.stack([w, x, y, z], axis=1), written.quats)
    assert np.array_equal(values[f"{PREFIX}SCALE"], written.scales)
    assert np.array_equal(values[f"{PREFIX}OPACITY"][:, 0], written.opacities)
    names = [f"SH_DEGREE_{d}_COEF_{i}" for d in range(degree + 1) for i in range(2 * d + 1)]
    harmonics = np.stack([values[PREFIX + name] for name in names], axis=1)
    assert np.array_equal(harmonics, written.harmonics)
    assert len(values) == len(names) + 5, "nothing else"


def test_the_primitive_is_points_with_what_the_extension_requires():
    document, values = read_glb(glb_bytes(cloud()))
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    settings = primitive["extensions"]["KHR_gaussian_splatting"]
    assert settings["kernel"] == "ellipse"
    assert settings["colorSpace"] == "srgb_rec709_display"
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    assert "extensionsRequired" not in document, "others may draw the points"
    position = document["accessors"][primitive["attributes"]["POSITION"]]
    assert np.array_equal(np.float32(position["min"]), values["POSITION"].min(0))
    assert np.array_equal(np.float32(position["max"]), values["POSITION"].max(0))


def test_what_does_not_know_splats_sees_coloured_points():
    written = cloud(degree=0)
    scene: Any = trimesh.load(io.BytesIO(glb_bytes(written)), file_type="glb")
    (points,) = scene.geometry.values()
    assert np.allclose(points.vertices, written.means, atol=1e-6)
    colors = (0.28209479 * written.harmonics[:, 0] + 0.5).clip(0, 1) * 255
    assert np.abs(np.asarray(points.colors)[:, :3] - colors).max() <= 0.5 + 1e-4
    assert np.abs(np.asarray(points.colors)[:, 3] - written.opacities * 255).max() <= 0.5 + 1e-4
