"""Gather the wheels for `make gpu WHEELS=folder` on a machine without a network.

    python3 -m lab.gpu.collect FOLDER --python 3.12 --has there.txt

Any Python with pip will do. `there.txt` lists what that machine's Python has beside torch, for
instance `python3 -m pip list --format=freeze` from there; what it lists does not travel. Versions
are those of constraints.txt.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from lab.arguments import parser_of
from lab.documents import CHECKOUT
from lab.gpu.wheels import (
    ARCHIVE,
    LEFT_OUT,
    LIMIT,
    MADE_FOR,
    NEEDED,
    canonical,
    largest,
    names_in,
    pack,
    pinned,
    size_of,
)

PLATFORMS = ["manylinux2014_x86_64", "manylinux1_x86_64"]
PLATFORMS += [f"manylinux_2_{minor}_x86_64" for minor in (17, 24, 27, 28, 31, 34, 35)]
"""pip takes these names exactly."""


class CollectionError(Exception):
    """Wheels that cannot be had, or that are too large."""


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_of("python3 -m lab.gpu.collect", __doc__)
    parser.add_argument("folder", type=Path, help="made; must be empty")
    here = f"{sys.version_info[0]}.{sys.version_info[1]}"
    parser.add_argument("--python", default=here, help="of that machine (%(default)s)")
    parser.add_argument("--has", type=Path, help="file that lists what that machine has already")
    return parser.parse_args(arguments)


def requirements(python: str, there: set[str]) -> list[str]:
    """`name==version` of what has to travel to a Python that has `there` already."""
    versions = pinned((CHECKOUT / "constraints.txt").read_text("utf8"), python)
    wanted = [name for name in map(canonical, NEEDED) if name not in there]
    return [f"{name}=={versions[name]}" if name in versions else name for name in wanted]


def download(wanted: Sequence[str], python: str, folder: Path) -> None:
    """The wheels of requirements, without what they require.

    Raises:
        CollectionError: pip could not get them.
    """
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
    command += [word for platform in PLATFORMS for word in ("--platform", platform)]
    command += ["--dest", str(folder), *wanted]
    if subprocess.run(command).returncode != 0:
        raise CollectionError(
            f"pip could not get all wheels for Python {python}; it says above which. Where it "
            "says that there is no module pip, run this with a Python that has it."
        )


def check_size(size: int, sizes: Mapping[str, int]) -> None:
    """Args:
        size: bytes of what travels.
        sizes: of the single wheels, to say what takes the most.

    Raises:
        CollectionError: it is more than `LIMIT`.
    """
    if size <= LIMIT:
        return
    lines = "\n".join(largest(sizes))
    raise CollectionError(
        f"The collection takes {size / 1e6:.1f} MB, and {LIMIT / 1e6:.0f} MB may travel; nothing "
        f"was kept. The largest wheels:\n{lines}\nList what that machine's Python has already in "
        "a file, and name it with --has."
    )


def collect(folder: Path, python: str, there: set[str]) -> dict[str, int]:
    """Fill the folder; returns the sizes of the wheels by name, as downloaded.

    Raises:
        CollectionError: the folder is not empty, or wheels are missing or too large.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CollectionError(f"{folder} exists and is not an empty folder. Name another.")
    with tempfile.TemporaryDirectory(prefix="desplat-wheels-") as name:
        beside = Path(name)
        download(requirements(python, there), python, beside)
        wheels = sorted(beside.glob("*.whl"))
        sizes = {wheel.name.partition("-")[0]: wheel.stat().st_size for wheel in wheels}
        folder.mkdir(parents=True, exist_ok=True)
        archive = folder / ARCHIVE
        try:
            pack(wheels, archive)
            check_size(archive.stat().st_size, sizes)
        except BaseException:
            archive.unlink(missing_ok=True)
            raise
    (folder / MADE_FOR).write_text(f"{python}\n")
    return sizes


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    chosen = parse_arguments(arguments)
    there = names_in(chosen.has.read_text("utf8")) if chosen.has else set()
    try:
        sizes = collect(chosen.folder, chosen.python, there)
    except CollectionError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    whole = size_of(chosen.folder) / 1e6
    print(f"{len(sizes)} wheels of {sum(sizes.values()) / 1e6:.1f} MB in {whole:.1f} MB:")
    print("\n".join(largest(sizes, len(sizes))))
    already = [name for name in map(canonical, NEEDED) if name in there]
    print(f"\nThere already: {', '.join(already) or 'nothing'}.")
    print("Left out, torch and CUDA aside, for no part imports it:")
    print("\n".join(f"  {name} ({why})" for name, why in LEFT_OUT.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
