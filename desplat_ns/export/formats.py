"""The formats of splats, by the ending of the file's name.

To add one, write a function from a `SplatCloud` to the file's bytes and enter it in `FORMATS`; what
reads it back in a test must share no code with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import SplatCloud

Frame = Literal["upright", "capture", "training"]
"""In which coordinates a file is; see `coordinates.similarity_to`."""

Naming = Literal["colmap", "nerfstudio"]
"""Of masks. colmap: photo.jpg.png. nerfstudio: photo.png, in place of the photo's own ending."""

Axes = tuple[tuple[int, ...], ...]
"""A matrix [3, 3] of 0 and +-1 that turns one convention's axes into another's."""

Y_UP: Axes = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
"""nerfstudio's axes (x right, y forward, z up) as x right, y up, z backward: glTF's, and SPZ's."""

Y_DOWN: Axes = ((1, 0, 0), (0, 0, -1), (0, 1, 0))
"""... as x right, y down, z forward: what viewers expect of a PLY, and turn upright."""


@dataclass(frozen=True)
class Format:
    """A file format for splats."""

    name: str
    module: str
    function: str
    """Makes the file's bytes from a `SplatCloud`; imported when it is needed."""
    upright_axes: Axes
    """From nerfstudio's axes to those that viewers take for upright in such a file."""
    keeps_antialiasing: bool = False
    """Whether it says that opacities are meant for Mip-Splatting's low-pass filter."""
    fits: str = ""
    """Leaves out what the format cannot hold well; as `function`. Empty: it holds everything."""

    def fitting(self, cloud: SplatCloud) -> tuple[SplatCloud, list[str]]:
        """What the file is to hold of a cloud, and lines about the rest for the user."""
        return self._named(self.fits)(cloud) if self.fits else (cloud, [])

    def bytes_of(self, cloud: SplatCloud) -> bytes:
        """The file's content. Raises ConfigError where the format cannot hold it."""
        return self._named(self.function)(cloud)

    def _named(self, function: str) -> Callable[[SplatCloud], Any]:
        return getattr(import_module(f"desplat_ns.export.{self.module}"), function)


FORMATS = {
    ".ply": Format("PLY", "ply", "ply_bytes", Y_DOWN),
    ".spz": Format("SPZ", "spz", "spz_bytes", Y_UP, keeps_antialiasing=True, fits="fitting"),
    ".glb": Format("glTF with KHR_gaussian_splatting", "gltf", "glb_bytes", Y_UP),
}

PAGE_ENDING = ".html"
"""Of a page with the scene in it, which another command writes."""


def format_of(path: Path) -> Format:
    """The format that a file's name asks for.

    Raises:
        ConfigError: none has this ending.
    """
    chosen = FORMATS.get(path.suffix.lower())
    if path.suffix.lower() == PAGE_ENDING:
        raise ConfigError(f"'{path}' is a page: write it with `desplat-export page`.")
    if chosen is None:
        known = ", ".join(f"{suffix} ({kind.name})" for suffix, kind in FORMATS.items())
        ending = f"the ending '{path.suffix}'" if path.suffix else "no ending"
        raise ConfigError(f"--output is '{path}', which has {ending}. Known are: {known}.")
    return chosen
