"""A reader of binary glTF, written from the specification of glTF 2.0, for what we write only."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

DTYPES = {5121: np.uint8, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def read_glb(content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The JSON, and the attributes of the first primitive; normalized bytes come as [0, 1]."""
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at < length:
        size, kind = struct.unpack_from("<I4s", content, at)
        assert size % 4 == 0
        chunks[kind] = content[at + 8 : at + 8 + size]
        at += 8 + size
    document = json.loads(chunks[b"JSON"])
    attributes = {}
    for name, number in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][number]
        part = document["bufferViews"][accessor["bufferView"]]
        assert part["byteOffset"] % 4 == 0
        values = np.frombuffer(
            chunks[b"BIN\0"][part["byteOffset"] :][: part["byteLength"]],
            DTYPES[accessor["componentType"]],
        ).reshape(accessor["count"], WIDTHS[accessor["type"]])
        attributes[name] = values / 255 if accessor.get("normalized") else values
    return document, attributes
