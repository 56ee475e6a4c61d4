"""The layouts of captures that are recognised, in the order in which they are tried.

To add one, write what finds it and enter it in `LAYOUTS`, before those that are less specific.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig
from nerfstudio.data.dataparsers.blender_dataparser import BlenderDataParserConfig
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
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig, describe
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.photo_tourism.dataparser import (
    ROOTS,
    PhotoTourismDataParserConfig,
    split_folders,
)
from desplat_ns.photo_tourism.split_file import split_files

IMAGES = DeSplatColmapDataParserConfig().images_path
"""Folder of the photos; beside it, `images_N` has copies at 1/N of their size."""

BLENDER_FILES = tuple(f"transforms_{split}.json" for split in ("train", "val", "test"))
"""What nerfstudio's blender-data reads: the splits of training, of evaluation while it goes on, and
of ns-eval."""


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


def option_of(name: str) -> str:
    """How a field is called on the command line: `--eval-mode` for eval_mode."""
    return f"--{name.replace('_', '-')}"


def _on_the_go(data: Path) -> Evidence | None:
    """split.json with the lists of NeRF On-the-go, and poses."""
    model, has_transforms = _model_of(data), (data / TRANSFORMS_FILE).is_file()
    if not (model or has_transforms):
        return None
    try:
        lists = read_split(data / SPLIT_FILE)
    except CaptureError:
        return None
    counts = ", ".join(f"{len(positions)} {name}" for name, positions in lists.items())
    return Evidence(
        f"{SPLIT_FILE} ({counts}) with {model or TRANSFORMS_FILE}",
        _photos(data)[1],
        covers=("robustnerf-data", "nerfstudio-data", "colmap"),
    )


def _robustnerf(data: Path) -> Evidence | None:
    """`extra` and `clutter` or `clean` in the names of photos, over a COLMAP model."""
    model = _model_of(data)
    images, options = _photos(data)
    names = photo_names(images) if model else []
    stems = [Path(name).stem.lower() for name in names]
    if not any("extra" in stem for stem in stems):
        return None
    if not any("clutter" in stem or "clean" in stem for stem in stems):
        return None
    summary = f"photos named by what they show ({describe(names)}) and {model}"
    return Evidence(summary, options, covers=("colmap",))


def _photo_tourism(data: Path) -> Evidence | None:
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
        return Evidence(f"{model} ({held_out})", covers=("colmap",))
    return None


def _transforms(data: Path) -> Evidence | None:
    """A transforms.json, or such a file named itself."""
    path = data if data.suffix == ".json" else data / TRANSFORMS_FILE
    return Evidence(path.name, {"load_3D_points": True}) if path.is_file() else None


def _blender(data: Path) -> Evidence | None:
    """transforms_train.json with its siblings, as blender-data reads them."""
    if not (data / BLENDER_FILES[0]).is_file() or blender_misfit(data):
        return None
    return Evidence(", ".join(BLENDER_FILES))


def blender_misfit(data: Path) -> str:
    """Why blender-data cannot read a folder that has transforms_train.json; empty if it can.

    It takes one `camera_angle_x` for all photos, and adds .png to every `file_path`.
    """
    for name in BLENDER_FILES:
        if not (data / name).is_file():
            return f"{name} missing"
        try:
            document: Any = json.loads((data / name).read_text("utf8"))
            angle, photo = document["camera_angle_x"], f"{document['frames'][0]['file_path']}.png"
        except (OSError, ValueError, LookupError, TypeError) as error:
            return f"{name} cannot be read ({type(error).__name__}: {error})"
        if not isinstance(angle, (int, float)) or not (data / photo).is_file():
            return f"{name} has the camera_angle_x {angle}, and names a photo {photo}"
    return ""


def _blender_config(data: Path, **options: Any) -> BlenderDataParserConfig:
    """blender-data's configuration.

    Raises:
        ConfigError: options that it does not have.
    """
    useless = [name for name in options if name != "scale_factor"]
    if useless:
        given = " ".join(f"{option_of(name)} {options[name]}" for name in useless)
        raise ConfigError(
            f"{given} has no use here: {data} is read by nerfstudio's blender-data, which has "
            "--scale-factor alone of these options. Leave it out, or see `blender-data --help` at "
            "the end of the command."
        )
    return BlenderDataParserConfig(data=data, **options)


def _colmap(data: Path) -> Evidence | None:
    """A COLMAP model in a usual place; photos, or smaller copies as Mip-NeRF 360 has them."""
    model = _model_of(data)
    if not model:
        return None
    copies = "".join(f", {IMAGES}_{factor}" for factor in downscale_factors(data / IMAGES))
    return Evidence(f"{model}{copies}", _photos(data)[1])


LAYOUTS = (
    Layout(
        "NeRF On-the-go",
        "split.json with transforms.json or a COLMAP model",
        "on-the-go-data",
        OnTheGoDataParserConfig,
        _on_the_go,
        "split.json",
    ),
    Layout(
        "RobustNeRF",
        "images/ with clean or clutter, and extra, in the file names, and a COLMAP model",
        "robustnerf-data",
        RobustNerfDataParserConfig,
        _robustnerf,
        "the photos' file names",
    ),
    Layout(
        "Photo Tourism",
        "dense/images and dense/sparse",
        "photo-tourism-data",
        PhotoTourismDataParserConfig,
        _photo_tourism,
        "the split file, or without one a draw,",
    ),
    Layout(
        "nerfstudio",
        "transforms.json",
        "nerfstudio-data",
        partial(NerfstudioDataParserConfig, _target=TransformsDataParser),
        _transforms,
    ),
    Layout(
        "Blender (NeRF synthetic)",
        "transforms_train.json, transforms_val.json and transforms_test.json",
        "blender-data",
        _blender_config,
        _blender,
        "transforms_train.json with those beside it",
    ),
    Layout(
        "COLMAP",
        "images/, or images_2, images_4, ..., and a COLMAP model (cameras, images and points3D as "
        ".bin or .txt) in sparse/0, sparse or colmap/sparse/0",
        "colmap",
        DeSplatColmapDataParserConfig,
        _colmap,
    ),
)
"""The most specific ones first: the first that is found is taken."""


def _model_of(data: Path) -> str:
    """COLMAP's model in a usual place, as part of a sentence; empty if there is none."""
    models = find_models(data, Path("sparse"))
    if not models:
        return ""
    folder = models[0] if len(models) == 1 else models[0].parent  # of several, the parser takes one
    return f"COLMAP's model in {folder.relative_to(data).as_posix()}"


def _photos(data: Path) -> tuple[Path, dict[str, Any]]:
    """Folder of the photos, or of the largest copies if they are all there is; the options with
    which a dataparser reads it."""
    images = data / IMAGES
    factors = downscale_factors(images)
    if images.is_dir() or not factors:
        return images, {}
    return data / f"{IMAGES}_{factors[0]}", {"downscale_factor": factors[0]}
