"""Files of splats read back by a program that shares no code with ours."""

from __future__ import annotations

import gaussforge
import numpy as np

from desplat_ns.export.splat_cloud import SplatCloud


def read_splats(content: bytes, kind: str = "spz") -> SplatCloud:
    """By gaussforge, a program in C++, for SPZ around the format's reference implementation."""
    data = gaussforge.GaussForge().read(content, kind)["data"]

    def array(name: str, *shape: int) -> np.ndarray:
        return np.frombuffer(data[name], np.float32).reshape(data["numPoints"], *shape)

    return SplatCloud(
        means=array("positions", 3).astype(np.float64),
        quats=array("rotations", 4),
        scales=np.exp(array("scales", 3)),
        opacities=1 / (1 + np.exp(-array("alphas"))),
        harmonics=np.concatenate([array("colors", 1, 3), array("sh", -1, 3)], axis=1),
    )
