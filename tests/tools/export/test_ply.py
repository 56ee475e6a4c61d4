"""PLY read back by plyfile, and by a program in C++."""

import io
from dataclasses import replace

import numpy as np
import pytest
from plyfile import PlyData

from desplat_ns.tools.export.ply import ply_bytes
from tests.helpers.splat_files import cloud


def columns(table, *names: str) -> np.ndarray:
    return np.stack([table[name] for name in names], axis=-1)


@pytest.mark.parametrize("degree", [0, 3])
def test_plyfile_reads_every_value_back(degree: int):
    written = cloud(degree=degree)
    table = PlyData.read(io.BytesIO(ply_bytes(written)))["vertex"].data
    assert np.array_equal(columns(table, "x", "y", "z"), written.means.astype(np.float32))
    quats = columns(table, "rot_0", "rot_1", "rot_2", "rot_3")
    assert np.array_equal(quats, written.quats)
    scales = np.exp(columns(table, "scale_0", "scale_1", "scale_2").astype(np.float64))
    assert np.allclose(scales, written.scales, rtol=4 * 2.0**-24)  # |log| < 4
    opacities = 1 / (1 + np.exp(-table["opacity"].astype(np.float64)))
    assert np.allclose(opacities, written.opacities, atol=2.0**-24)
    dc = columns(table, "f_dc_0", "f_dc_1", "f_dc_2")
    assert np.array_equal(dc, written.harmonics[:, 0])
    rest = [name for name in table.dtype.names if name.startswith("f_rest_")]
    assert rest == [f"f_rest_{i}" for i in range(3 * ((degree + 1) ** 2 - 1))]
    for i, name in enumerate(rest):  # all of red, then green, then blue
        channel, base = divmod(i, len(rest) // 3)
        assert np.array_equal(table[name], written.harmonics[:, 1 + base, channel])


def test_opacities_of_0_and_1_have_finite_logits():
    full = replace(cloud(count=2), opacities=np.array([0, 1], np.float32))
    table = PlyData.read(io.BytesIO(ply_bytes(full)))["vertex"].data
    assert np.isfinite(table["opacity"]).all()
    assert table["opacity"][0] < -80 and table["opacity"][1] > 16
