"""The formats of splats by the ending of the file's name, and the choices of `desplat-export`.

To add one, write a function from a `SplatCloud` to the file's bytes and enter it here and in
`export.WRITERS`; what reads it back in a test must share no code with it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

from desplat_ns.errors import ConfigError

Frame = Literal["upright", "capture", "training"]
"""In which coordinates a file is; see `splat_cloud.similarity_to`."""

Naming = Literal["colmap", "nerfstudio"]
"""Of masks. colmap: photo.jpg.png. nerfstudio: photo.png, in place of the photo's own ending."""

Axes = tuple[tuple[int, ...], ...]
"""A matrix [3, 3] of 0 and +-1 that turns one convention's axes into another's."""

Y_UP: Axes = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
"""nerfstudio's axes (x right, y forward, z up) as x right, y up, z backward: glTF's, and SPZ's."""

Y_DOWN: Axes = ((1, 0, 0), (0, 0, -1), (0, 1, 0))
"""... as x right, y down, z forward: what viewers expect of a PLY, and turn upright."""


class Format(NamedTuple):
    """A file format for splats."""

    name: str
    upright_axes: Axes
    """From nerfstudio's axes to those that viewers take for upright in such a file."""


FORMATS = {
    ".ply": Format("PLY", Y_DOWN),
    ".spz": Format("SPZ", Y_UP),
    ".glb": Format("glTF with KHR_gaussian_splatting", Y_UP),
}


def format_of(path: Path) -> Format:
    """The format that a file's name asks for. Raises ConfigError where none has this ending."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        known = ", ".join(f"{suffix} ({kind.name})" for suffix, kind in FORMATS.items())
        raise ConfigError(
            f"--output is '{path}'; give it one of the endings {known}. `desplat-export page` "
            "writes .html."
        )
    return FORMATS[suffix]
