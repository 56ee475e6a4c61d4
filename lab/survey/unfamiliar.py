"""Generated and altered captures unlike those on which the survey's thresholds were set: rooms of
bare walls and gloss, detail as fine as a pixel, few views, difficult occluders, a house behind a
lawn, a table before a far room."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from desplat_ns.datamanager import training_split
from desplat_ns.errors import DeSplatError
from desplat_ns.studies.methods import parse
from desplat_ns.survey.findings import Decision
from desplat_ns.survey.observations import Capture, capture_of
from lab.separation.runs import CLEAN, FEW, HARD, PLACES, SCENES, downscale_of

CHOSEN_ON = ("room15", "room40", "grove18", "few12", "small", "facade8", "facade16", "table20")
"""And their clean twins: here it was seen that gloss, fine detail and what is in the way are taken
for light, and what was done about it was chosen. The others are kept out,
but are of the same kinds: other seeds of the rooms and groves, other things over the same fox."""


def names() -> Iterator[str]:
    """Every scene of the separation study that counts here."""
    for name in (*PLACES, *FEW):
        yield from (name, name + CLEAN)
    yield from HARD


def was_chosen_on(name: str) -> bool:
    """Whether something was chosen on it, or on its twin."""
    return name.removesuffix(CLEAN) in CHOSEN_ON


def right_of(name: str) -> dict[str, tuple[Decision, ...]]:
    """Which decisions are right. The photos of the fox drift in exposure, which `camera` explains;
    nothing else has any light of its own. What is true of the background is not clear: a strip of
    sky above walls, or between trees."""
    is_fox = name.removesuffix(CLEAN) not in PLACES
    return {"appearance": ("off", "camera") if is_fox else ("off",)}


def open_capture(name: str, folder: Path) -> Capture:
    """Its training photos, written below `folder` if they are not there yet.

    Raises:
        DeSplatError: it is made of a real capture that is not there.
    """
    scene = SCENES[name]
    smaller = ("--downscale-factor", str(downscale_of(name)))
    options = ("--data", str(scene.capture.locate(folder)), *scene.parser, *smaller)
    config = parse("desplat", list(options))
    config.pipeline.datamanager.data = config.data
    return capture_of(training_split(config.pipeline.datamanager))


def available(folder: Path) -> Iterator[tuple[str, Capture]]:
    """Name and photos of each capture that can be made."""
    for name in names():
        try:
            yield name, open_capture(name, folder)
        except DeSplatError as error:
            print(f"{name} is left out: {error}", flush=True)
