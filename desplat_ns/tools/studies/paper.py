"""The paper's tables: data sets as they are trained on and scored, methods, metrics, and the
figures of Tables A5 to A7 of its supplement. A8 and A9 are times of a Tesla V100.

`paper.txt` has a line for each row: table and metrics, row, and the figures scene by scene in the
order of `TABLES`, a dash where the paper has one. A7 has the mean behind them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

from desplat_ns.core.options import LpipsNet
from desplat_ns.evaluation.config import ProtocolName

TableName = Literal["robustnerf", "on-the-go", "A5", "A6", "A7"]
LPIPS_NET: LpipsNet = "alex"
"""The supplement names none. nerfstudio 1.1.4, on which the paper is built (B.3), calls LPIPS
without naming one, which gives AlexNet."""
MEAN = "mean"
"""The column of means over all scenes of a table."""


@dataclass(frozen=True)
class PaperScene:
    """A scene as the paper uses it (B.1); docs/compare-with-desplat.md has the protocols."""

    data_set: str
    """Also the folder that `desplat-fetch-data` makes for the data set."""
    name: str
    """As the paper calls it."""
    folder: str
    """In the published data set."""
    reader: tuple[str, ...]
    """Name and options of the data parser, as `ns-train` takes them, but for the resolution."""
    downscale: int | None
    """Photos at 1/N of their size; None: what the data parser takes by itself."""
    scoring: ProtocolName = "full"
    """Which pixels, and in which light; `half` becomes `right` for models without light."""
    steps: int = 30_000
    """Of every method; B.3 gives them for DeSplat."""
    place: Path = Path()
    """Where the folder lies here, once it is found."""

    @property
    def fetch(self) -> str:
        """What `desplat-fetch-data` calls the download that holds it."""
        one_by_one = self.data_set == "phototourism"
        return self.folder.replace("_", "-") if one_by_one else self.data_set

    @property
    def parser(self) -> tuple[str, ...]:
        """Name and options of the data parser, as `ns-train` takes them."""
        smaller = () if self.downscale is None else ("--downscale-factor", str(self.downscale))
        return (*self.reader, *smaller)


def _scenes(data_set: str, downscale: int | None, names: str, *reader: str) -> list[PaperScene]:
    """Scenes `A, B C (1)`, whose folders are called `a` and `b_c1`."""
    reader, scenes = reader or (f"{data_set}-data",), list[PaperScene]()
    for name in names.split(", "):
        folder = re.sub("[ -]", "_", re.sub(r" \((\d)\)", r"\1", name).lower())
        scenes.append(PaperScene(data_set, name, folder, reader, downscale))
    return scenes


ROBUSTNERF = _scenes("robustnerf", 8, "Statue, Android, Crab (1), Crab (2), Yoda")
ON_THE_GO = [
    *_scenes("on-the-go", 8, "Mountain, Fountain, Corner"),
    *_scenes("on-the-go", 4, "Patio"),
    *_scenes("on-the-go", 8, "Spot, Patio-High"),
]
_TOURISM_NAMES = "Brandenburg Gate, Sacre Coeur, Trevi Fountain"
PHOTO_TOURISM = [
    replace(scene, scoring="half", steps=200_000)  # B.3
    for scene in _scenes("phototourism", None, _TOURISM_NAMES, "photo-tourism-data")
]
_EIGHTH = ("colmap", "--eval-mode", "interval", "--eval-interval", "8")
MIPNERF360 = [
    *_scenes("mipnerf360", 4, "bicycle, garden, stump", *_EIGHTH),
    *_scenes("mipnerf360", 2, "room, counter, kitchen, bonsai", *_EIGHTH),
]


@dataclass(frozen=True)
class Method:
    """A registered method with options."""

    name: str
    method: str
    """That nerfstudio knows."""
    paper: str = ""
    """The row of the paper's tables that it stands beside; empty for none."""
    options: tuple[str, ...] = ()
    """Of `ns-train`."""
    has_light: bool = False
    """Whether it has an embedding for each photo."""


_EFFECTS = "--pipeline.model.effects"
_STATIC = (f"{_EFFECTS}.distractors", "False")
_W = (*_STATIC, f"{_EFFECTS}.appearance", "sh")
_W_A = (*_W, f"{_EFFECTS}.background", "off")
_TOURISM, _TOURISM_A = "desplat-phototourism-paper", "desplat-phototourism-a-paper"
METHODS = {
    method.name: method
    for method in (
        Method("desplat", "desplat", "DeSplat"),
        Method("desplat-paper", "desplat-paper", "DeSplat"),
        Method("splatfacto", "desplat-paper", "Splatfacto", _STATIC),
        Method("desplat-phototourism", "desplat-phototourism", "DeSplat", has_light=True),
        Method(_TOURISM, _TOURISM, "DeSplat", has_light=True),
        Method(_TOURISM_A, _TOURISM_A, "DeSplat-A", has_light=True),
        Method("splatfacto-w", _TOURISM, "Splatfacto-W", _W, has_light=True),
        Method("splatfacto-w-a", _TOURISM, "Splatfacto-W-A", _W_A, has_light=True),
    )
}
"""Splatfacto has this package's settings, and Splatfacto-W's appearance model is without masks."""


@dataclass(frozen=True)
class Metric:
    """A figure of a table."""

    name: str
    """Of the evaluation's score."""
    title: str
    form: str = ".2f"
    """How tables write it."""

    def text(self, value: float | None, sign: str = "") -> str:
        """As tables write it; with `sign` "+" also a positive value has its sign."""
        return "-" if value is None else format(value, sign + self.form)


_IMAGES = (
    Metric("psnr", "PSNR, dB, the higher the better"),
    Metric("ssim", "SSIM, the higher the better", ".3f"),
    Metric("lpips", "LPIPS, the lower the better", ".3f"),
)
_MEMORY = (
    Metric("static_memory_mb", "Static Gaussians, MB (10^6 bytes)"),
    Metric("distractor_memory_mb", "Distractor Gaussians, MB (10^6 bytes)"),
)


@dataclass(frozen=True)
class Table:
    """A table of the paper."""

    name: TableName
    title: str
    scenes: Sequence[PaperScene]
    """In the order of the columns."""
    metrics: tuple[Metric, ...]
    note: str = ""
    """What else a reader of the figures has to know."""
    methods: tuple[str, ...] = ("desplat", "desplat-paper", "splatfacto")
    """That are compared, if no others are asked for."""


_MAIN_TEXT = "The paper's figures are in its main text; this package has those of the supplement."
_MB = "The paper does not say which MB it means."
_BOTH = (*ROBUSTNERF, *ON_THE_GO)
_LIT = tuple(name for name, method in METHODS.items() if method.has_light)
_A5 = (*_LIT[:3], "splatfacto", *_LIT[3:])
TABLES: dict[TableName, Table] = {
    table.name: table
    for table in (
        Table("robustnerf", "RobustNeRF", ROBUSTNERF, _IMAGES, _MAIN_TEXT),
        Table("on-the-go", "NeRF On-the-go", ON_THE_GO, _IMAGES, _MAIN_TEXT),
        Table("A5", "Table A5: Photo Tourism", PHOTO_TOURISM, _IMAGES, methods=_A5),
        Table("A6", "Table A6: Mip-NeRF 360", MIPNERF360, _IMAGES),
        Table("A7", "Table A7: memory", _BOTH, _MEMORY, _MB),
    )
}
"""By the name that is typed."""


@cache
def figures_of(table: TableName) -> dict[tuple[str, str, str], float | None]:
    """All figures of a table, by row, scene or `MEAN`, and metric; none of one that is in the main
    text. Rows are called as in the text: DeSplat, and DeSplat-A without background."""
    figures: dict[tuple[str, str, str], float | None] = {}
    columns = [*(scene.name for scene in TABLES[table].scenes), MEAN]
    for line in Path(__file__).with_suffix(".txt").read_text("utf8").splitlines():
        of, row, values = (part.strip() for part in line.split("|"))
        name, *metrics = of.split()
        if name == table:
            places = [(row, scene, metric) for scene in columns for metric in metrics]
            found = (None if word == "-" else float(word) for word in values.split())
            figures |= zip(places, found, strict=False)  # A5, A6: no mean
    return figures
