"""Shared by the readers of captures: lists of names, files that must exist, console lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from nerfstudio.utils.rich_utils import CONSOLE
from rich.markup import escape

from desplat_ns.errors import CaptureError

LISTED_NAMES = 10
"""So many names are listed in an error; the rest is counted."""


def announce(line: str, warning: bool = False) -> None:
    """Print one line on nerfstudio's console; paths stay whole, brackets in them are kept."""
    style = "yellow" if warning else None
    CONSOLE.print(escape(line), style=style, soft_wrap=True, highlight=False)


def list_names(names: Iterable[str]) -> str:
    """`a, b, c and 12 more`: the first names and how many are left."""
    all_names = list(names)
    listed = ", ".join(all_names[:LISTED_NAMES])
    rest = len(all_names) - LISTED_NAMES
    return f"{listed} and {rest} more" if rest > 0 else listed


def check_files(paths: Sequence[Path], folder: Path, what: str, option: str) -> None:
    """Make sure that all files are there.

    Raises:
        CaptureError: lists what is missing from `folder`, `what` it is, and the `option` to set.
    """
    missing = [path for path in paths if not path.is_file()]
    if not missing:
        return
    if not folder.is_dir():
        raise CaptureError(f"The {what} folder {folder} does not exist. Name it with {option}.")
    names = list_names(_below(path, folder) for path in missing)
    raise CaptureError(
        f"{len(missing)} of {len(paths)} {what} that the capture names are not in {folder}: "
        f"{names}. Put them there, or name their folder with {option}."
    )


def _below(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)
