"""Gaussians as PLY, with the properties that 3DGS writes: what every viewer reads.

Letters in shapes: N Gaussians.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from desplat_ns.export.splat_cloud import SplatCloud

OPAQUE = 1 - 2.0**-24
"""The largest opacity below 1 in float32: a logit is finite."""


def ply_bytes(cloud: SplatCloud) -> bytes:
    """A binary PLY: x, y, z, normals (0), f_dc, f_rest, opacity, scale, rot; all float32.

    As 3DGS has them: logarithms of scales, logits of opacities, quaternions wxyz, and of f_rest all
    of red first, then green, then blue.
    """
    rest = cloud.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(cloud), -1)
    columns = {
        **_named(cloud.means, "{}", "xyz"),
        **_named(np.zeros_like(cloud.means), "n{}", "xyz"),
        **_named(cloud.harmonics[:, 0], "f_dc_{}"),
        **_named(rest, "f_rest_{}"),
        "opacity": logit(cloud.opacities),
        **_named(np.log(cloud.scales), "scale_{}"),
        **_named(cloud.quats, "rot_{}"),
    }
    table = np.empty(len(cloud), dtype=[(name, "<f4") for name in columns])
    for name, values in columns.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment written by desplat-ns",
        f"element vertex {len(cloud)}",
        *(f"property float {name}" for name in columns),
        "end_header",
    ]
    return "".join(f"{line}\n" for line in header).encode("ascii") + table.tobytes()


def _named(
    values: Float[np.ndarray, "N _"], pattern: str, names: str | None = None
) -> dict[str, np.ndarray]:
    """Columns by name; numbered where there are no names."""
    labels = names or range(values.shape[1])
    return {pattern.format(label): values[:, i] for i, label in enumerate(labels)}


def logit(opacities: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """log(p / (1 - p)), finite: 0 and 1 are taken as the nearest numbers between."""
    p = np.clip(opacities.astype(np.float64), np.finfo(np.float32).tiny, OPAQUE)
    return np.log(p) - np.log1p(-p)
