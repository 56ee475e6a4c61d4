"""Gaussians as binary glTF with KHR_gaussian_splatting: exact, and read by general 3D software.

Source: glTF 2.0 and the extension KHR_gaussian_splatting, as ratified: linear scales, opacities
after the sigmoid, quaternions xyzw, +Y up. Letters in shapes: N Gaussians.
"""

import json
import struct
from collections.abc import Iterator

import numpy as np

from desplat_ns import __version__
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.tools.export.splat_cloud import SplatCloud, xyzw

EXTENSION = "KHR_gaussian_splatting"
COMPONENTS = {np.dtype("<f4"): 5126, np.dtype("u1"): 5121}
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
"""glTF's numbers of component types, and its names of columns."""


def glb_bytes(cloud: SplatCloud) -> bytes:
    """The file: a header, the JSON, the numbers. Nothing is lost beyond float32."""
    attributes, accessors, views, binary = dict[str, int](), [], [], bytearray()
    for name, values in _columns(cloud):
        accessor = {"bufferView": len(views), "componentType": COMPONENTS[values.dtype]}
        accessor |= {"count": len(values), "type": KINDS[values.shape[1]]}
        if values.dtype == np.uint8:
            accessor["normalized"] = True
        if name == "POSITION":  # glTF asks for these of positions
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        attributes[name] = len(accessors)
        accessors.append(accessor)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        binary += values.tobytes()
    settings = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    settings |= {"projection": "perspective", "sortingMethod": "cameraDistance"}
    primitive = {
        "attributes": attributes,
        "mode": 0,  # points, for what does not know the extension
        "extensions": {EXTENSION: settings},
    }
    document = {
        "asset": {"version": "2.0", "generator": f"desplat-ns {__version__}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} | ({"translation": cloud.offset} if cloud.offset else {})],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _columns(cloud: SplatCloud) -> Iterator[tuple[str, np.ndarray]]:
    """The columns of a point primitive; each is a whole number of 4 bytes long."""
    yield "POSITION", cloud.means.astype("<f4")
    colors = np.column_stack([C0 * cloud.harmonics[:, 0] + 0.5, cloud.opacities])
    yield "COLOR_0", np.rint(colors * 255).clip(0, 255).astype(np.uint8)  # for points
    yield f"{EXTENSION}:ROTATION", xyzw(cloud.quats).astype("<f4")
    yield f"{EXTENSION}:SCALE", cloud.scales.astype("<f4")
    yield f"{EXTENSION}:OPACITY", cloud.opacities.astype("<f4")[:, None]
    for degree in range(cloud.degree + 1):
        for i in range(2 * degree + 1):
            name = f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{i}"
            yield name, np.ascontiguousarray(cloud.harmonics[:, degree**2 + i], "<f4")
