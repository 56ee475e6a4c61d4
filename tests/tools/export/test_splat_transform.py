"""PlayCanvas' splat-transform, by which SuperSplat reads files, reads ours."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from desplat_ns.tools.export.ply import ply_bytes
from desplat_ns.tools.export.spz import spz_bytes
from tests.helpers.splat_files import cloud


@pytest.mark.parametrize(
    ("ending", "write", "axes"), [("ply", ply_bytes, (1, 1, 1)), ("spz", spz_bytes, (1, -1, -1))]
)
def test_splat_transform_reads_every_gaussian(ending: str, write, axes, tmp_path: Path):
    """Within half of SPZ's steps; y is up in an SPZ, which it turns to a PLY's y down."""
    program = shutil.which("splat-transform")
    if program is None:
        pytest.skip("no splat-transform: npm install --global @playcanvas/splat-transform")
    written, source, read = cloud(), tmp_path / f"a.{ending}", tmp_path / "b.ply"
    source.write_bytes(write(written))
    subprocess.run([program, source, read], check=True, capture_output=True)
    table = PlyData.read(read)["vertex"].data
    means = np.stack([table[axis] for axis in "xyz"], axis=1)
    assert np.abs(means * axes - written.means).max() <= 2.0**-21 + 8 * 2.0**-24  # below 8 units
    opacities = 1 / (1 + np.exp(-table["opacity"].astype(np.float64)))
    assert np.abs(opacities - written.opacities).max() <= 1 / 510 + 1e-6
    red = np.abs(table["f_dc_0"] - written.harmonics[:, 0, 0])
    assert red.max() <= 0.5 / (255 * 0.15) + 1e-6
