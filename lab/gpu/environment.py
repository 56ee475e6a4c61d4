"""Make the environment of `make gpu WHEELS=folder`, without a network: standard library and pip.

    python3 -m lab.gpu.environment FOLDER VENV

The new environment sees what this Python has, its torch above all. What the folder brings goes
before that, and is installed with `--no-deps`.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import sysconfig
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

from lab.documents import CHECKOUT
from lab.gpu.wheels import ARCHIVE, LIMIT, MADE_FOR, size_of, unpack

BESIDE = "desplat_beside.pth"


class NoEnvironment(Exception):
    """A folder or a Python that no environment can be made of."""


def check_folder(folder: Path, python: tuple[int, int]) -> Path:
    """The archive of a folder.

    Raises:
        NoEnvironment: it is missing, too large, or for another Python.
    """
    archive = folder / ARCHIVE
    lacking = [name for name in (ARCHIVE, MADE_FOR) if not (folder / name).is_file()]
    if lacking:
        raise NoEnvironment(
            f"WHEELS={folder} holds no {lacking[0]}, as a whole collection does. Make the folder "
            "where there is a network: python3 -m lab.gpu.collect FOLDER"
        )
    size = size_of(folder)
    if size > LIMIT:
        raise NoEnvironment(
            f"WHEELS={folder} takes {size / 1e6:.1f} MB, more than the {LIMIT / 1e6:.0f} MB that "
            "`lab.gpu.collect` makes: it holds something else. Collect it anew."
        )
    wanted = (folder / MADE_FOR).read_text().strip()
    here = ".".join(map(str, python))
    if wanted != here:
        raise NoEnvironment(
            f"The wheels of {folder} are for Python {wanted} and this is Python {here}. Collect "
            f"with `--python {here}`, or name another interpreter with PYTHON=."
        )
    return archive


def check_torch() -> None:
    """Raises NoEnvironment where this Python has no torch."""
    if importlib.util.find_spec("torch") is None:
        raise NoEnvironment(
            "This Python has no torch, which does not travel in the folder. Name one that has it "
            "with PYTHON=/path/to/python3."
        )


def make_environment(archive: Path, place: Path, checkout: Path | None = CHECKOUT) -> None:
    """Make, or make anew, the environment at `place` from the wheels of an archive.

    Args:
        checkout: of this project, which is entered as well, unless it is None.

    Raises:
        NoEnvironment: pip could not install them.
    """
    venv.create(place, system_site_packages=True, clear=True, with_pip=False)
    _see_this_python(place)
    with tempfile.TemporaryDirectory(prefix="desplat-wheels-") as folder:
        wheels = [str(path) for path in unpack(archive, Path(folder))]
        _install(place, wheels)
    if checkout is not None:
        _install(place, ["--no-build-isolation", "--editable", str(checkout)])


def _see_this_python(place: Path) -> None:
    """Where this Python is itself a virtual environment, `venv` would look past it to its base."""
    if sys.prefix == sys.base_prefix:
        return
    folders = dict.fromkeys(sysconfig.get_path(kind) for kind in ("purelib", "platlib"))
    lines = [f"import site; site.addsitedir({folder!r})" for folder in folders]
    (_site_of(place) / BESIDE).write_text("\n".join(lines) + "\n")


def _site_of(place: Path) -> Path:
    names = {"base": str(place), "platbase": str(place)}
    return Path(sysconfig.get_path("purelib", "venv", names))


def _install(place: Path, what: Sequence[str]) -> None:
    python = place / "bin" / "python"
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    command += ["--no-index", "--no-deps", "--no-compile", "--ignore-installed"]
    command += ["--disable-pip-version-check", *what]
    if subprocess.run(command).returncode != 0:
        raise NoEnvironment("pip could not install the wheels; it says above why.")


def main(arguments: Sequence[str]) -> int:
    """Entry point."""
    if len(arguments) != 2:
        print("Usage: python3 -m lab.gpu.environment FOLDER VENV", file=sys.stderr)
        return 2
    folder, place = Path(arguments[0]), Path(arguments[1])
    try:
        archive = check_folder(folder, sys.version_info[:2])
        check_torch()
        make_environment(archive, place)
    except NoEnvironment as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
