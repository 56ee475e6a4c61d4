"""Which layout a capture has: what was found, what else could be read, or what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

from desplat_ns.console import list_names
from desplat_ns.data.checks import how_to_get_poses
from desplat_ns.data.photo_files import photos_near
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.layouts.table import (
    BLENDER_FILES,
    LAYOUTS,
    Evidence,
    Layout,
    blender_misfit,
    option_of,
)

SPLIT_OPTIONS = ("eval_mode", "train_split_fraction", "eval_interval")
"""Options without a meaning where the layout itself says which photos are held out."""

LISTED_ENTRIES = 5
"""Entries of a folder that an error names before it only counts."""


@dataclass(frozen=True)
class Match:
    """A layout that a folder has."""

    layout: Layout
    evidence: Evidence

    @property
    def words(self) -> tuple[str, ...]:
        """What names this reading at the end of an ns-train command."""
        options = [(option_of(name), str(value)) for name, value in self.evidence.options.items()]
        return (self.layout.parser, *(word for option in options for word in option))


@dataclass(frozen=True)
class Recognition:
    """What lies in a capture's folder and how it is read."""

    data: Path
    match: Match
    others: tuple[Match, ...]
    """Other readings that see other photos or poses."""

    def line(self) -> str:
        """What was found, what reads it, and what to type for another reading."""
        layout = self.match.layout
        return (
            f"Capture {self.data} has the layout of {layout.name}: {self.match.evidence.summary}. "
            f"It is read by {layout.parser}."
        ) + "".join(
            f" Also found: {other.evidence.summary}; to read that instead, end the command "
            f"with `{' '.join(other.words)}`."
            for other in self.others
        )

    def config(self, options: Mapping[str, Any]) -> DataParserConfig:
        """The configuration of the dataparser that reads the capture.

        Args:
            options: what the user gave, by the names of the fields; they come before the layout's.

        Raises:
            ConfigError: options that this layout has no use for.
        """
        layout = self.match.layout
        useless = [name for name in SPLIT_OPTIONS if layout.split_by and name in options]
        if useless:
            given = " ".join(f"{option_of(name)} {options[name]}" for name in useless)
            raise ConfigError(
                f"{given} has no use here: {self.data} has the layout of {layout.name}, where "
                f"{layout.split_by} decides which photos are held out. Leave it out, or see the "
                f"options of {layout.parser}: end the command with `{layout.parser} --help`."
            )
        return layout.config(data=self.data, **{**self.match.evidence.options, **options})


def recognise(data: Path) -> Recognition:
    """The layout of the capture in a folder; a transforms.json may be named itself.

    Raises:
        CaptureError: no such folder, or nothing in it that is a capture.
    """
    if not data.exists():
        raise CaptureError(f"There is no folder {data}. Check the path after --data.")
    if data.is_file() and data.suffix != ".json":
        raise CaptureError(
            f"{data} is a file. --data takes the folder of a capture, or its transforms.json."
        )
    matches = _matches(data)
    if not matches:
        raise CaptureError(_nothing_found(data))
    taken, *others = matches
    known = taken.evidence.covers
    return Recognition(data, taken, tuple(m for m in others if m.layout.parser not in known))


def _matches(data: Path) -> list[Match]:
    candidates = ((layout, layout.find(data)) for layout in LAYOUTS)
    return [Match(layout, evidence) for layout, evidence in candidates if evidence is not None]


def _nothing_found(data: Path) -> str:
    entries = sorted(path.name for path in data.iterdir())
    if not entries:
        return f"The folder {data} is empty. Check the path after --data."
    if BLENDER_FILES[0] in entries:
        path = data / BLENDER_FILES[0]
        return (
            f"{path} cannot be read by nerfstudio's blender-data: {blender_misfit(data)}. Where it "
            f"has nerfstudio's fields (fl_x, fl_y, cx, cy, w, h), name the file itself: --data "
            f"{path}; nerfstudio-data reads it then and holds out one in ten of its photos. To "
            "keep the splits, put all frames into one transforms.json with the lists "
            "train_filenames, val_filenames and test_filenames."
        )
    inside = [name for name in entries if (data / name).is_dir() and _matches(data / name)]
    if inside:
        return (
            f"{data} is no capture, but holds some: {list_names(inside, LISTED_ENTRIES)}. Name "
            f"one, for example --data {data / inside[0]}."
        )
    above = data.resolve().parent
    if _matches(above):
        return f"{data} is a part of the capture {above}. Name that: --data {above}."
    photos = photos_near(data)
    if photos:
        return (
            f"{data} has {len(photos)} photos ({list_names(photos, LISTED_ENTRIES)}) and no poses "
            f"of their cameras. {how_to_get_poses(data)}"
        )
    looked = "; or ".join(layout.needs for layout in LAYOUTS)
    return (
        f"No capture was found in {data}, which has {list_names(entries, LISTED_ENTRIES)}. Needed "
        f"is one of these: {looked}. Check the path after --data, or name a dataparser at the end "
        "of the command (ns-train desplat --help lists them)."
    )
