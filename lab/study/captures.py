"""The captures: real ones in the folder that DESPLAT_NS_DATA names, generated and altered ones."""

import hashlib
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from desplat_ns.core.errors import DeSplatError
from lab.separation.few_views import keep_views
from lab.separation.hard_cases import CASES, RECURRING, make_case
from lab.synthetic import SceneSpec, write_scene

DATA_VARIABLE = "DESPLAT_NS_DATA"
"""Environment variable with the folder that holds real captures."""

PASTED = ("robustnerf-data",)
TWINS = ("--train-split-clean-clutter-ratio", "0")
"""Of `robustnerf-data`: the same photos, taken before anything was in the way."""


@dataclass(frozen=True)
class Capture:
    """Photos and how they are read."""

    name: str
    locate: Callable[[Path], Path]
    """Its folder; what has to be made is made below the given folder, once.

    Raises DeSplatError where it is not there and cannot be made."""
    parser: tuple[str, ...]
    downscale: int = 1
    """Photos are read at 1/N of their size."""

    def words(self) -> tuple[str, ...]:
        """Name and options of the data parser."""
        size = ("--downscale-factor", str(self.downscale)) if self.downscale > 1 else ()
        return (*self.parser, *size)


def _real(name: str, _: Path) -> Path:
    folder = Path(os.environ.get(DATA_VARIABLE, "")) / name
    if not folder.is_dir():
        raise DeSplatError(
            f"The capture '{name}' is not at '{folder}'. Set {DATA_VARIABLE} to the folder that "
            "holds it."
        )
    return folder


def _generated(spec: SceneSpec, folder: Path) -> Path:
    digest = hashlib.sha256(repr(spec).encode()).hexdigest()[:6]
    place = folder / f"{spec.place}{spec.num_views}-{spec.seed}-{digest}"
    return made(place, partial(write_scene, spec))


def _altered(name: str, alter: Callable[[Path, Path], object], folder: Path) -> Path:
    original = _real("fox_cluttered", folder).resolve()
    return made(folder / name, partial(alter, original))


def made(path: Path, make: Callable[[Path], object]) -> Path:
    """What `make` writes; beside its place first, so that a stopped study leaves nothing half."""
    if not path.exists():
        draft = path.with_name(f"{path.name}.draft")
        shutil.rmtree(draft, ignore_errors=True)
        make(draft)
        draft.rename(path)
    return path


PLACES = {
    "facade8": SceneSpec.facade(8, seed=7),
    "table20": SceneSpec.table_top(20, seed=7),
    "other-facade8": SceneSpec.facade(8, seed=8),
    "other-facade16": SceneSpec.facade(16, seed=8),
    "other-table20": SceneSpec.table_top(20, seed=8),
}
"""Generated: a house behind a lawn, a table before a far room. Thresholds were chosen on seed 7;
seed 8 is kept out."""

HARD = (*CASES, RECURRING)
"""One kind of difficult occluder each, pasted over `fox_cluttered`'s clean photos."""


def _captures() -> list[Capture]:
    fox = partial(Capture, parser=PASTED, downscale=2)
    return [
        fox("fox_cluttered", partial(_real, "fox_cluttered")),
        *(fox(f"few{n}", partial(_altered, f"few{n}", partial(keep_views, n))) for n in (12, 20)),
        fox("monstree_cluttered", partial(_real, "monstree_cluttered")),
        fox("sceaux_cluttered", partial(_real, "sceaux_cluttered")),
        *(Capture(name, partial(_generated, spec), PASTED) for name, spec in PLACES.items()),
        *(fox(name, partial(_altered, name, partial(make_case, name))) for name in HARD),
        *(
            Capture(name, partial(_real, name), ("colmap",), 2)
            for name in ("fox", "monstree", "fox_relit")
        ),
        Capture("sacre_coeur", partial(_real, "sacre_coeur"), ("photo-tourism-data",)),
    ]


CAPTURES = {capture.name: capture for capture in _captures()}
"""By name. Nothing moves in `fox`, `monstree` and `fox_relit`; `sacre_coeur` has many lights and
skies."""
