"""What gsplat's kernels take, as the headers of its sources declare them, and whether a call fits.

The headers are compiled into the module, so its own signatures are these; beside types, their
comments tell shapes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

HEADERS = ("bindings.h", "Ops.h")
"""Of gsplat 1.4 and 1.5."""

NUMBERS = {"uint32_t": int, "int64_t": int, "int": int, "float": float, "bool": bool}

INTEGERS = {
    **{"radii": torch.int32, "flatten_ids": torch.int32, "tile_offsets": torch.int32},
    **{"last_ids": torch.int32, "isect_ids": torch.int64, "masks": torch.bool},
}
"""Types of tensors by name, where it is not float32."""

SHAPES = {
    ("rasterize_to_pixels_fwd", "opacities"): "[C, N]",
    ("rasterize_to_pixels_bwd", "opacities"): "[C, N]",
    ("rasterize_to_pixels_bwd", "colors"): "[C, N, D]",
    ("rasterize_to_pixels_bwd", "v_render_colors"): "[C, image_height, image_width, D]",
    ("rasterize_to_pixels_3dgs_bwd", "colors"): "[C, N, D]",
    ("rasterize_to_pixels_3dgs_bwd", "v_render_colors"): "[C, image_height, image_width, D]",
}
"""Where a comment of gsplat 1.4.0 or 1.5.3 is wrong: the kernels read opacities at the same index
as means, and as many channels as `colors` has (rasterize_to_pixels_*.cu, RasterizeToPixels*.cu)."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a kernel."""

    name: str
    kind: str
    """Its type in C++ without namespaces: "Tensor", "uint32_t", "CameraModelType"."""
    is_optional: bool
    shapes: tuple[str, ...]
    """What the comment says of a tensor: "[C, N, 3]"; none where it says nothing."""

    def misfit(self, value: Any, sizes: dict[str, int]) -> str | None:
        """Why a value is none for this parameter.

        Args:
            sizes: what the names in shapes stand for, as far as they are known; is added to.
        """
        if value is None:
            return None if self.is_optional else "is None and not optional"
        if self.kind == "Tensor":
            return self._misfit_of_tensor(value, sizes)
        if self.kind not in NUMBERS:
            return None  # an enumeration of gsplat's own
        wanted = NUMBERS[self.kind]
        if type(value) is not wanted and not (wanted is float and type(value) is int):
            return f"is of type {type(value).__name__}, not {self.kind}"
        if self.kind == "uint32_t" and not 0 <= value < 2**32:
            return f"is {value}"
        if wanted is int and sizes.setdefault(self.name, value) != value:
            return f"is {value}, not {sizes[self.name]}"
        return None

    def _misfit_of_tensor(self, value: Any, sizes: dict[str, int]) -> str | None:
        if not isinstance(value, Tensor):
            return f"is of type {type(value).__name__}, not a tensor"
        dtype = INTEGERS.get(self.name, torch.float32)
        if value.dtype != dtype:
            return f"is {value.dtype}, not {dtype}"
        if not value.is_contiguous():
            return "is not contiguous"
        for shape in self.shapes:
            bound = _bind(shape, value.shape, sizes)
            if bound is not None:
                sizes |= bound
                return None
        return f"is {list(value.shape)}, not {' or '.join(self.shapes)}" if self.shapes else None


def _bind(shape: str, sizes: Sequence[int], known: Mapping[str, int]) -> dict[str, int] | None:
    """What the names in a shape such as "[..., N, 3]" stand for; None where it does not fit."""
    names = [name.strip() for name in shape.strip("[] ").split(",") if name.strip()]
    sizes = list(sizes)
    if names[:1] == ["..."]:
        names, sizes = names[1:], sizes[max(0, len(sizes) - len(names) + 1) :]
    if len(names) != len(sizes):
        return None
    bound = dict(known)
    for name, size in zip(names, sizes, strict=True):
        wanted = int(name) if name.isdigit() else bound.setdefault(name, size)
        if wanted != size:
            return None
    return bound


def read_declarations(gsplat: Path) -> dict[str, tuple[Parameter, ...]]:
    """Parameters of each kernel by its name in Python.

    Args:
        gsplat: folder of the installed package.

    Raises:
        FileNotFoundError: it has no header that is known.
    """
    paths = [path for name in HEADERS for path in gsplat.glob(f"cuda/*/{name}")]
    if not paths:
        raise FileNotFoundError(f"{gsplat} has none of {', '.join(HEADERS)}")
    text = paths[0].read_text("utf8")
    kernels = {}
    for match in re.finditer(r"\b(\w+)\(\n(.*?)^\s*\);", text, flags=re.MULTILINE | re.DOTALL):
        name = match[1].removesuffix("_tensor")
        kernels[name] = tuple(_parameters(name, match[2]))
    return kernels


def _parameters(kernel: str, text: str) -> list[Parameter]:
    line = re.compile(r"^\s*(?:const\s+)?([\w:<>]+)\s*&?\s*(\w+)\s*,?\s*(?://\s*(.*))?$")
    parameters = []
    for match in filter(None, map(line.match, text.splitlines())):
        kind, name, comment = match[1], match[2], match[3] or ""
        given = SHAPES.get((kernel, name))
        shapes = (given,) if given else tuple(re.findall(r"\[[^\]]*\]", comment))
        bare = re.sub(r".*::|>", "", kind)
        parameters.append(Parameter(name, bare, "optional" in kind, shapes))
    return parameters


def misfits(kernel: str, parameters: Sequence[Parameter], values: Sequence[Any]) -> list[str]:
    """What of a call does not fit a kernel, a line for each."""
    if len(parameters) != len(values):
        return [f"{kernel} takes {len(parameters)} values and is given {len(values)}"]
    sizes: dict[str, int] = {}
    lines = []
    for parameter, value in zip(parameters, values, strict=True):
        misfit = parameter.misfit(value, sizes)
        if misfit is not None:
            lines.append(f"{kernel}: {parameter.name} {misfit}")
    return lines
