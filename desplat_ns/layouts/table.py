"""The layouts of captures that are recognised, in the order in which they are tried.

To add one, write what finds it and enter it in `LAYOUTS`, before those that are less specific.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.on_the_go import (
    SPLIT_FILE,
    TRANSFORMS_FILE,
    OnTheGoDataParserConfig,
    read_split,
)
from desplat_ns.data.photo_files import downscale_factors, photo_names
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.robustnerf_names import describe
from desplat_ns.data.transforms_json import PromptFreeNerfstudio
from desplat_ns.errors import CaptureError
from desplat_ns.layouts.blender import FILES, TRAIN_FILE, blender_config, misfit
from desplat_ns.photo_tourism.dataparser import (
    ROOTS,
    PhotoTourismDataParserConfig,
    split_folders,
)
from desplat_ns.photo_tourism.split_file import split_files

MODEL = Path("sparse")
"""Stands for all usual places of a COLMAP model, see `colmap_model.find_models`."""


IMAGES = DeSplatColmapDataParserConfig().images_path
"""Folder of the photos; beside it, `images_N` has copies at 1/N of their size."""


@dataclass(frozen=True)
class Evidence:
    """Why a folder is taken for a layout."""

    summary: str
    """What lies there, as part of a sentence."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the dataparser that it calls for."""
    covers: tuple[str, ...] = ()
    """Dataparsers that could read the same photos and would know less about them."""


@dataclass(frozen=True)
class Layout:
    """A way in which captures lie on disk."""

    name: str
    """What it is called."""
    needs: str
    """What has to lie in the folder."""
    parser: str
    """Name of the dataparser in ns-train."""
    config: Callable[..., DataParserConfig]
    """Makes the dataparser's configuration from its options."""
    find: Callable[[Path], Evidence | None]
    """None if the folder has another layout."""
    split_by: str = ""
    """What says which photos are held out, if not --eval-mode and the options beside it."""


def find_on_the_go(data: Path) -> Evidence | None:
    """split.json with the lists of NeRF On-the-go, and poses."""
    posed_by = _posed_by(data)
    if not posed_by:
        return None
    try:
        lists = read_split(data / SPLIT_FILE)
    except CaptureError:
        return None
    counts = ", ".join(f"{len(positions)} {name}" for name, positions in lists.items())
    return Evidence(
        f"{SPLIT_FILE} ({counts}) with {posed_by}",
        _photos(data)[1],
        covers=("robustnerf-data", "nerfstudio-data", "colmap"),
    )


def find_robustnerf(data: Path) -> Evidence | None:
    """`extra` and `clutter` or `clean` in the names of photos, over a COLMAP model."""
    model = _model_of(data)
    if not model:
        return None
    images, options = _photos(data)
    names = photo_names(images)
    stems = [Path(name).stem.lower() for name in names]
    if not any("extra" in stem for stem in stems):
        return None
    if not any("clutter" in stem or "clean" in stem for stem in stems):
        return None
    return Evidence(
        f"photos named by what they show ({describe(names)}) and COLMAP's model in {model}",
        options,
        covers=("colmap",),
    )


def find_photo_tourism(data: Path) -> Evidence | None:
    """dense/ with photos and a COLMAP model, or a NeRF-W split file beside them."""
    split, _ = split_files(split_folders(data))
    held_out = (
        f"the split file {split[0].name}" if split else "no split file: a draw holds photos out"
    )
    dense = ROOTS[0]
    if find_models(data, dense / "sparse") and (data / dense / "images").is_dir():
        return Evidence(f"{dense}/images and {dense}/sparse ({held_out})")
    model = _model_of(data)
    if model and (split or data.resolve().name == dense.name):
        return Evidence(f"COLMAP's model in {model} ({held_out})", covers=("colmap",))
    return None


def find_transforms(data: Path) -> Evidence | None:
    """A transforms.json, or such a file named itself."""
    path = data if data.suffix == ".json" else data / TRANSFORMS_FILE
    return Evidence(path.name, {"load_3D_points": True}) if path.is_file() else None


def find_blender(data: Path) -> Evidence | None:
    """transforms_train.json with its siblings, as blender-data reads them."""
    if not (data / TRAIN_FILE).is_file() or misfit(data):
        return None
    return Evidence(", ".join(FILES))


def find_colmap(data: Path) -> Evidence | None:
    """A COLMAP model in a usual place; photos, or smaller copies as Mip-NeRF 360 has them."""
    model = _model_of(data)
    if not model:
        return None
    copies = "".join(f", {IMAGES}_{factor}" for factor in downscale_factors(data / IMAGES))
    return Evidence(f"COLMAP's model in {model}{copies}", _photos(data)[1])


LAYOUTS = (
    Layout(
        "NeRF On-the-go",
        "split.json with transforms.json or a COLMAP model",
        "on-the-go-data",
        OnTheGoDataParserConfig,
        find_on_the_go,
        "split.json",
    ),
    Layout(
        "RobustNeRF",
        "images/ with clean or clutter, and extra, in the file names, and a COLMAP model",
        "robustnerf-data",
        RobustNerfDataParserConfig,
        find_robustnerf,
        "the photos' file names",
    ),
    Layout(
        "Photo Tourism",
        "dense/images and dense/sparse",
        "photo-tourism-data",
        PhotoTourismDataParserConfig,
        find_photo_tourism,
        "the split file, or without one a draw,",
    ),
    Layout(
        "nerfstudio",
        "transforms.json",
        "nerfstudio-data",
        partial(NerfstudioDataParserConfig, _target=PromptFreeNerfstudio),
        find_transforms,
    ),
    Layout(
        "Blender (NeRF synthetic)",
        "transforms_train.json, transforms_val.json and transforms_test.json",
        "blender-data",
        blender_config,
        find_blender,
        "transforms_train.json with those beside it",
    ),
    Layout(
        "COLMAP",
        "images/, or images_2, images_4, ..., and a COLMAP model (cameras, images and points3D as "
        ".bin or .txt) in sparse/0, sparse or colmap/sparse/0",
        "colmap",
        DeSplatColmapDataParserConfig,
        find_colmap,
    ),
)
"""The most specific ones first: the first that is found is taken."""


def _model_of(data: Path) -> str:
    """Folder of the COLMAP model, relative to the data; empty if there is none."""
    models = find_models(data, MODEL)
    if not models:
        return ""
    folder = models[0] if len(models) == 1 else models[0].parent  # of several, the parser takes one
    return folder.relative_to(data).as_posix()


def _photos(data: Path) -> tuple[Path, dict[str, Any]]:
    """Folder of the photos, or of the largest copies if they are all there is; the options with
    which a dataparser reads it."""
    images = data / IMAGES
    factors = downscale_factors(images)
    if images.is_dir() or not factors:
        return images, {}
    return data / f"{IMAGES}_{factors[0]}", {"downscale_factor": factors[0]}


def _posed_by(data: Path) -> str:
    model = _model_of(data)
    if model:
        return f"COLMAP's model in {model}"
    return TRANSFORMS_FILE if (data / TRANSFORMS_FILE).is_file() else ""
