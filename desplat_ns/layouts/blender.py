"""Captures as the "NeRF synthetic" scenes have them: transforms_train.json and its siblings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nerfstudio.data.dataparsers.blender_dataparser import BlenderDataParserConfig

from desplat_ns.errors import ConfigError

TRAIN_FILE = "transforms_train.json"

FILES = (TRAIN_FILE, "transforms_val.json", "transforms_test.json")
"""What nerfstudio's blender-data reads: the splits of training, of evaluation while it goes on, and
of ns-eval."""


def misfit(data: Path) -> str:
    """Why blender-data cannot read a folder that has `TRAIN_FILE`; empty if it can.

    It takes one `camera_angle_x` for all photos, and adds .png to every `file_path`.
    """
    missing = [name for name in FILES if not (data / name).is_file()]
    if missing:
        return f"{' and '.join(missing)} missing"
    for name in FILES:
        try:
            document: Any = json.loads((data / name).read_text("utf8"))
            paths = [str(frame["file_path"]) for frame in document["frames"]]
            angle = document.get("camera_angle_x")
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            return f"{name} cannot be read ({type(error).__name__}: {error})"
        if not isinstance(angle, (int, float)):
            return f"{name} has no camera_angle_x"
        if not paths:
            return f"{name} has no frames"
        if not (data / f"{paths[0]}.png").is_file():
            return f"{name} names {paths[0]}, and there is no {paths[0]}.png"
    return ""


def what_to_do(data: Path) -> str:
    """The error of a folder with a `TRAIN_FILE` that blender-data cannot read."""
    return (
        f"{data} has a {TRAIN_FILE}, but nerfstudio's blender-data cannot read it: "
        f"{misfit(data)}. Where it has nerfstudio's fields (fl_x, fl_y, cx, cy, w, h), name the "
        f"file itself: --data {data / TRAIN_FILE}; nerfstudio-data reads it then and holds out one "
        "in ten of its photos. To keep the splits, put all frames into one transforms.json with "
        "the lists train_filenames, val_filenames and test_filenames."
    )


def blender_config(data: Path, **options: Any) -> BlenderDataParserConfig:
    """blender-data's configuration.

    Raises:
        ConfigError: options that it does not have.
    """
    useless = [name for name in options if name != "scale_factor"]
    if useless:
        given = " ".join(f"--{name.replace('_', '-')} {options[name]}" for name in useless)
        raise ConfigError(
            f"{given} has no use here: {data} is read by nerfstudio's blender-data, which has "
            "--scale-factor alone of these options. Leave it out, or see `blender-data --help` at "
            "the end of the command."
        )
    return BlenderDataParserConfig(data=data, **options)
