"""What a machine without a network needs beside its own torch, and how it travels.

Standard library only: it is read there before anything is installed.

All of nerfstudio's dependencies take gigabytes. The parts import less: `NEEDED` is what they, and
the tests that need a GPU, import, `LEFT_OUT` the large rest, which nerfstudio imports only in
commands that are not measured. So `pip install --no-deps` is used.

A wheel compresses each file by itself. Unpacked and compressed together they take a third less:
the archive holds them stored, and xz compresses the archive.
"""

from __future__ import annotations

import io
import re
import tarfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

ARCHIVE = "wheels.tar.xz"
MADE_FOR = "python.txt"
"""Which Python the wheels are for, "3.12"."""

LIMIT = 64_000_000
"""Bytes of a folder at most."""

NEEDED = (
    # nerfstudio, the rasterizer, the package itself
    *("nerfstudio", "gsplat", "hatchling", "editables", "pathspec", "trove-classifiers", "pluggy"),
    # what the package imports
    *("numpy", "numba", "llvmlite", "pycolmap", "openimageio", "pillow", "jaxtyping"),
    *("wadler-lindig", "pytorch-msssim", "torchmetrics", "lightning-utilities", "rich"),
    *("markdown-it-py", "mdurl", "pygments", "psutil", "jinja2", "markupsafe", "matplotlib"),
    *("contourpy", "cycler", "fonttools", "kiwisolver", "packaging", "pyparsing"),
    *("python-dateutil", "six", "fpsample", "opencv-python-headless"),
    # what nerfstudio imports for training and scoring
    *("tyro", "docstring-parser", "typeguard", "typing-extensions", "viser", "websockets"),
    *("msgspec", "imageio", "trimesh", "requests", "urllib3", "idna", "certifi"),
    *("charset-normalizer", "tqdm", "appdirs", "rawpy", "pyquaternion", "tensorly", "scipy"),
    *("splines", "nerfacc", "tensorboard", "absl-py", "protobuf", "grpcio", "markdown"),
    *("werkzeug", "pyyaml", "setuptools", "pathos"),
    *("ppft", "pox", "dill", "multiprocess", "scikit-learn", "joblib", "threadpoolctl", "ninja"),
    # the tests
    *("pytest", "iniconfig", "hypothesis", "sortedcontainers", "beartype", "mpmath", "plyfile"),
)
"""Names as in constraints.txt."""

LEFT_OUT: Mapping[str, str] = {
    "open3d": "ns-export of meshes",
    "nuscenes-devkit": "the nuScenes dataparser",
    "av": "videos",
    "imageio-ffmpeg": "videos",
    "embreex": "trimesh's ray casting",
    "pymeshlab": "meshes",
    "wandb": "logging to W&B",
    "comet-ml": "logging to Comet",
    "jupyterlab": "notebooks",
    "h5py": "other dataparsers",
    "scikit-image": "reference values of tests that need no GPU",
    "plotly": "the viewer's plots",
    "ipython": "notebooks",
    "torch-fidelity": "torchmetrics' FID",
    "mediapy": "ns-render",
    "shapely": "trimesh's paths",
    "pandas": "nuscenes-devkit",
    "timm": "other methods",
    "pyliblzfse": "Record3D captures",
    "ray": "studies on several machines",
    "ruff": "`make check`",
    "pyright": "`make check`",
}
"""Large packages that no part imports, and what they are for."""

_PINNED = re.compile(r"^([\w.-]+)==([\w.]+)\s*(?:;\s*python_version\s*(<|>=)\s*'([\d.]+)')?$")


def canonical(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned(constraints: str, python: str) -> dict[str, str]:
    """Versions by name that a constraints file gives for a Python such as "3.12"."""
    versions = {}
    for line in constraints.splitlines():
        match = _PINNED.match(line.partition("#")[0].strip())
        if match is None:
            continue
        name, version, sign, bound = match.groups()
        if sign is None or (_numbers(python) < _numbers(bound)) == (sign == "<"):
            versions[canonical(name)] = version
    return versions


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in version.split("."))


def names_in(listing: str) -> set[str]:
    """Packages that a listing names, one a line: bare, or as `pip list --format=freeze` does."""
    lines = (re.split(r"[=@ ;#]", line.strip(), maxsplit=1)[0] for line in listing.splitlines())
    return {canonical(name) for name in lines if name}


def pack(wheels: Iterable[Path], archive: Path) -> None:
    """All wheels in one archive, stored in it and compressed together."""
    with tarfile.open(archive, "w:xz") as tar:
        for wheel in sorted(wheels):
            content = _stored(wheel)
            entry = tarfile.TarInfo(wheel.name)
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))


def _stored(wheel: Path) -> bytes:
    """The same wheel without compression; nothing that its RECORD hashes changes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as new:
        for info in old.infolist():
            content = old.read(info)
            info.compress_type = zipfile.ZIP_STORED
            new.writestr(info, content)
    return buffer.getvalue()


def unpack(archive: Path, folder: Path) -> list[Path]:
    """The wheels of an archive, as files in `folder`."""
    wheels = []
    with tarfile.open(archive, "r:xz") as tar:
        for entry in tar:
            content = tar.extractfile(entry)
            if content is None or Path(entry.name).name != entry.name:
                continue  # no wheel of `pack`'s
            path = folder / entry.name
            path.write_bytes(content.read())
            wheels.append(path)
    return wheels


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def largest(sizes: Mapping[str, int], count: int = 12) -> list[str]:
    """Lines `59.7 MB  llvmlite`, the largest first."""
    first = sorted(sizes.items(), key=lambda item: -item[1])[:count]
    return [f"{size / 1e6:6.1f} MB  {name}" for name, size in first]
