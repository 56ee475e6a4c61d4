"""Which code is running: the commit of the package's files, or its version."""

from __future__ import annotations

import subprocess
from pathlib import Path

import desplat_ns

DIRTY = "-dirty"
"""Ends the commit where files of the package differ from it."""
SHORT = 7
"""Digits of a commit in a table."""


def code_version(package: Path | None = None) -> str:
    """The commit of the running `desplat_ns`, so that a figure can be traced to what made it.

    Args:
        package: the package's folder; by default that of the `desplat_ns` that is imported.

    Returns:
        The full hash, with `DIRTY` behind it where a file of the package was changed or added
        since; `desplat-ns` and the version where git does not track the package, for instance in
        a virtual environment, even one that lies inside a checkout.
    """
    package = package or Path(desplat_ns.__file__).parent
    try:
        _git(package, "ls-files", "--error-unmatch", "__init__.py")
        commit = _git(package, "rev-parse", "HEAD").strip()
        changed = _git(package, "status", "--porcelain", "--", ".")
    except (OSError, subprocess.CalledProcessError):
        return f"desplat-ns {desplat_ns.__version__}"
    return commit + DIRTY * bool(changed)


def short(commit: str) -> str:
    """A commit as tables give it; what is no commit stays as it is."""
    dirty = commit.endswith(DIRTY)
    digits = commit.removesuffix(DIRTY)
    is_hash = len(digits) == 40 and set(digits) <= set("0123456789abcdef")
    return (digits[:SHORT] if is_hash else digits) + ", with changes" * dirty


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
