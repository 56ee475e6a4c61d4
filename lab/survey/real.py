"""The real scenes and what is true of them, as far as somebody who looks at the photos can tell."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.photo_tourism.dataparser import PhotoTourismDataParserConfig
from desplat_ns.survey.findings import Decision
from desplat_ns.survey.observations import Capture, capture_of
from lab.grid.runs import DATA_VARIABLE

Allowed = dict[str, tuple[Decision, ...]]


@dataclass(frozen=True)
class RealScene:
    """One scene and which decisions are right."""

    name: str
    parser: type[DeSplatColmapDataParserConfig]
    right: Allowed
    content: str
    """What its photos show."""

    def open(self, root: Path, downscale_factor: int = 1) -> Capture:
        """Its training photos, so many times smaller."""
        config: DataParserConfig = self.parser(
            data=root / self.name, downscale_factor=downscale_factor
        )
        return capture_of(config.setup().get_dataparser_outputs("train"))


def _right(appearance: tuple[Decision, ...], background: Decision) -> Allowed:
    return {"appearance": appearance, "background": (background,)}


_INDOORS = _right(("off",), "off")
_TREE = _right(("off", "camera"), "off")
_CASTLE = _right(("camera",), "sh")

REAL = (
    RealScene("fox", DeSplatColmapDataParserConfig, _INDOORS, "a room; a few photos are darker"),
    RealScene(
        "fox_cluttered",
        RobustNerfDataParserConfig,
        _INDOORS,
        "the same with pasted things",
    ),
    RealScene(
        "fox_relit",
        DeSplatColmapDataParserConfig,
        _right(("camera",), "off"),
        "the same, each photo with a gain, a tint and a gamma",
    ),
    RealScene(
        "monstree",
        DeSplatColmapDataParserConfig,
        _TREE,
        "a tree that fills the photos; the white balance drifts a little, and a sky shows through "
        "leaves in the corners of a few",
    ),
    RealScene(
        "monstree_cluttered",
        RobustNerfDataParserConfig,
        _TREE,
        "the same with pasted things",
    ),
    RealScene(
        "sceaux_castle",
        DeSplatColmapDataParserConfig,
        _CASTLE,
        "a castle behind a lawn, one photo in evening light",
    ),
    RealScene(
        "sceaux_cluttered",
        RobustNerfDataParserConfig,
        _CASTLE,
        "the same with pasted things",
    ),
    RealScene(
        "sacre_coeur",
        PhotoTourismDataParserConfig,
        _right(("camera", "affine"), "image"),
        "eight tourists' photos of a church: crowds, and a sky that is another one each time",
    ),
    RealScene(
        "family",
        DeSplatColmapDataParserConfig,
        _right(("off", "camera"), "off"),
        "a walk around a statue in one light; the lens darkens the corners, the exposure drifts",
    ),
)


def available() -> Iterator[tuple[RealScene, Path]]:
    """The scenes below the folder that `DESPLAT_NS_DATA` names, if any."""
    root = Path(os.environ.get(DATA_VARIABLE) or "/nonexistent")
    yield from ((scene, root) for scene in REAL if (root / scene.name).is_dir())
