"""The formats of splats by the ending of the file's name, and the choices of `desplat-export`.

To add one, write a function from a `SplatCloud` to the file's bytes and enter it here and in
`export.WRITERS`; what reads it back in a test must share no code with it."""

from pathlib import Path
from typing import Literal

from desplat_ns.core.errors import ConfigError

FrameName = Literal["upright", "capture", "training"]
"""In which coordinates a file is; see `splat_cloud.similarity_to`."""
Naming = Literal["colmap", "nerfstudio"]
"""Of masks. colmap: photo.jpg.png. nerfstudio: photo.png, in place of the photo's own ending."""
Axes = tuple[tuple[int, ...], ...]
"""A matrix [3, 3] of 0 and +-1 that turns one convention's axes into another's."""
Y_UP: Axes = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
"""nerfstudio's axes (x right, y forward, z up) as x right, y up, z backward: SPZ's."""
Y_DOWN: Axes = ((1, 0, 0), (0, 0, -1), (0, 1, 0))
"""... as x right, y down, z forward: what viewers expect of a PLY, and turn upright."""
UPRIGHT: dict[str, Axes] = {".ply": Y_DOWN, ".spz": Y_UP}
"""By a file's ending: from nerfstudio's axes to those that viewers take for upright in it."""


def format_of(path: Path) -> str:
    """The ending of a file's name. Raises ConfigError where no format has it."""
    ending = path.suffix.lower()
    if ending not in UPRIGHT:
        raise ConfigError(
            f"--output is '{path}'; give it one of the endings {', '.join(UPRIGHT)}. "
            "`desplat-export page` writes .html."
        )
    return ending
