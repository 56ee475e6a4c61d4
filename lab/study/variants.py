"""The variants, and which of them run on which captures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from desplat_ns.tools.studies.runs import Run
from lab.study.captures import CAPTURES, CHOSEN, HARD, KEPT_OUT, TWINS

SEEDS = (42, 43, 44)

EFFECTS = "--pipeline.model.effects"
PROTOCOL = "--pipeline.evaluation.protocol"
BASELINES = "lab.reproduce.baselines"


@dataclass(frozen=True)
class Variant:
    """A method with options."""

    what: str
    """As tables call it."""
    method: str
    options: tuple[str, ...] = ()
    is_on_twins: bool = False
    """Whether it is trained on the photos without what is in the way."""


def _effects(**switches: str) -> tuple[str, ...]:
    pairs = ((f"{EFFECTS}.{name}", value) for name, value in switches.items())
    return tuple(word for pair in pairs for word in pair)


RATES = ("--full-rate-visits", "0")
"""Splatfacto's learning rates whatever the length of a run."""

GIVEN = (*RATES, f"{EFFECTS}.auto", "False")
"""Distractors alone, whatever a survey would say."""

OFF = (*GIVEN, "--pipeline.model.opacity-prior", "0", f"{EFFECTS}.distractors", "False")
"""Without what `desplat` charges for opacity: baselines are Splatfacto's own."""

SEPARATION = {
    "off": Variant("distractors off", "desplat", OFF),
    "trimmed": Variant("off, trimmed loss", f"{BASELINES}:by_residual", RATES),
    "paper": Variant("`desplat-paper`", "desplat-paper"),
    "desplat": Variant("**`desplat`**", "desplat", GIVEN),
    "truth": Variant("off, true masks as weights", f"{BASELINES}:by_truth", RATES),
    "twins": Variant("off, trained on the clean twins", "desplat", OFF, is_on_twins=True),
    "asked": Variant("`desplat`, as its survey says", "desplat", RATES),
}

A, FULL = "desplat-phototourism-a-paper", "desplat-phototourism-paper"
RIGHT, HALF = (PROTOCOL, "right"), (PROTOCOL, "half")


def _lit(
    what: str,
    method: str,
    appearance: str,
    background: str,
    distractors: bool = True,
    options: tuple[str, ...] = (),
) -> Variant:
    switches = _effects(appearance=appearance, background=background, distractors=str(distractors))
    right = RIGHT if appearance == "off" else ()
    return Variant(what, method, (*RATES, *options, *switches, *right))


LIGHT = {
    "plain": _lit("nothing (Splatfacto)", A, "off", "off", distractors=False),
    "distractors": _lit("distractors", A, "off", "off"),
    "background": _lit("distractors, background", FULL, "off", "image"),
    "affine": _lit("distractors, affine", A, "affine", "off"),
    "sh": _lit("distractors, sh", A, "sh", "off"),
    "affine-background": _lit("distractors, affine, background", FULL, "affine", "image"),
    "sh-background": _lit("distractors, sh, background", FULL, "sh", "image"),
    "tourism": _lit(
        "affine, background, and the distractors of `desplat`",
        *("desplat-phototourism", "affine", "image"),
        options=("--pipeline.model.num-downscales", "0"),
    ),
    "no-distractors": _lit("affine, background", FULL, "affine", "image", distractors=False),
}

NOTHING = _effects(distractors="False", appearance="off", background="off")
EVERYTHING = _effects(distractors="True", appearance="affine", background="image")

SURVEY = {
    "auto": Variant("as the survey says", "desplat", RIGHT),
    "auto-lit": Variant("as the survey says, in a light of each photo", "desplat", HALF),
    "nothing": Variant("nothing on", "desplat", (*NOTHING, *RIGHT)),
    "everything": Variant("everything on", "desplat", (*EVERYTHING, *HALF)),
    "camera": Variant(
        "appearance camera, the rest as the survey says",
        "desplat",
        (f"{EFFECTS}.appearance", "camera", *HALF),
    ),
    "no-sky": Variant(
        "no background, the rest as the survey says",
        "desplat",
        (f"{EFFECTS}.background", "off", *HALF),
    ),
}
"""All score right halves: in a light found on the left half where a photo can have one, in the
average light where it cannot."""

VARIANTS = SEPARATION | LIGHT | SURVEY
"""By name."""


def run_of(variant: str, capture: str, steps: int, seed: int, data: Path = Path()) -> Run:
    """A run of the study.

    Args:
        data: the capture's folder, which no name depends on.
    """
    chosen, photos = VARIANTS[variant], CAPTURES[capture]
    if chosen.is_on_twins:
        photos = CAPTURES[photos.twins or capture]
    parser = photos.words(*(TWINS if chosen.is_on_twins else ()))
    name = f"{variant}-{photos.name}"
    return Run(name, chosen.method, chosen.options, steps, seed, data, parser, photos.name)


Wanted = tuple[str, str, int, int]
"""Variant, capture, steps and seed."""


def _wanted(variants: str, captures: Iterable[str], steps: int, seeds: int) -> Iterator[Wanted]:
    for seed in SEEDS[:seeds]:
        for capture in captures:
            yield from ((variant, capture, steps, seed) for variant in variants.split())


LIT = ("fox_relit", "sceaux_cluttered", "sacre_coeur")
PLAIN = ("fox", "fox_cluttered", "monstree", "monstree_cluttered")

GROUPS: dict[str, list[Wanted]] = {
    "separation": [
        *_wanted("off desplat truth twins", KEPT_OUT, 3000, 3),
        *_wanted("off desplat paper trimmed truth twins", ["fox_cluttered"], 3000, 3),
        *_wanted("desplat", CHOSEN[1:], 3000, 3),
        *_wanted("off desplat", HARD, 3000, 3),
        *_wanted("off asked", ["fox", "monstree"], 3000, 3),
    ],
    "light": [*_wanted(" ".join(LIGHT), ["tourism", "sacre_coeur"], 1000, 1)],
    "survey": [
        *_wanted("auto nothing everything camera", PLAIN, 3000, 1),
        *_wanted("auto-lit nothing everything no-sky", LIT[1:], 3000, 1),
        *_wanted("auto-lit nothing everything", LIT[:1], 3000, 1),
        *_wanted("auto-lit nothing no-sky", LIT[1:], 3000, 3),
        *_wanted("auto-lit nothing", LIT[:1], 3000, 3),
    ],
}
"""Every run of the study, by what it is about; the important ones first."""
