"""Gaussians as PLY, with the properties that 3DGS writes: what every viewer reads."""

import io

import numpy as np
from plyfile import PlyData, PlyElement

from desplat_ns.tools.export.splat_cloud import SplatCloud

OPAQUE = 1 - 2.0**-24
"""The largest opacity below 1 in float32: a logit is finite."""


def ply_bytes(cloud: SplatCloud) -> bytes:
    """A binary PLY: x, y, z, normals (0), f_dc, f_rest, opacity, scale, rot; all float32.

    As 3DGS has them: logarithms of scales, logits of opacities, quaternions wxyz, and of f_rest all
    of red first, then green, then blue.
    """
    rest = cloud.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(cloud), -1)
    p = np.clip(cloud.opacities.astype(np.float64), np.finfo(np.float32).tiny, OPAQUE)
    parts = {
        "x y z": cloud.means,
        "nx ny nz": np.zeros_like(cloud.means),
        "f_dc_0 f_dc_1 f_dc_2": cloud.harmonics[:, 0],
        " ".join(f"f_rest_{i}" for i in range(rest.shape[1])): rest,
        "opacity": (np.log(p) - np.log1p(-p))[:, None],
        "scale_0 scale_1 scale_2": np.log(cloud.scales),
        "rot_0 rot_1 rot_2 rot_3": cloud.quats,
    }
    table = np.concatenate([values.astype("<f4") for values in parts.values()], axis=1)
    table = table.view([(name, "<f4") for name in " ".join(parts).split()])[:, 0]
    offset = [" ".join(["offset", *map(str, cloud.offset)])] if cloud.offset else []
    comments, file = ["written by desplat-ns", *offset], io.BytesIO()
    element = PlyElement.describe(table, "vertex")
    PlyData([element], byte_order="<", comments=comments).write(file)
    return file.getvalue()
