"""The report of a study: one HTML file that needs no other, and the plots beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from desplat_ns.files.pages import data_address, inline_svg, template, time_in_words
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.grid.code_version import short
from desplat_ns.studies.grid.train_and_score import PICTURES
from desplat_ns.studies.tradeoff.plan import BASE, SEEDS, compared
from desplat_ns.studies.tradeoff.plots import draw_all
from desplat_ns.studies.tradeoff.results import RUNS, Results
from desplat_ns.studies.tradeoff.summary import (
    NEEDED,
    SIGNIFICANT,
    Measured,
    Spread,
    best_within,
    decibels_to_tell,
    finals,
    least_ratio,
    measured,
    on_front,
    soonest_at,
    times_to_tell,
    verdicts,
)

FILE = "report.html"
TEMPLATE = Path(__file__).with_name("report.html.jinja")

MORE = {"ssim": "SSIM", "lpips": "LPIPS", "mask_iou": "mask IoU"}
"""Figures of a run beside its PSNR, as the table calls them."""

PICTURE_SIDE, PICTURE_QUALITY = 900, 85
"""Pixels of the longer side, and JPEG's, of pictures in the report."""


@dataclass(frozen=True)
class Row:
    """A variant at a number of steps, in words."""

    what: str
    steps: str
    psnr: str
    more: tuple[str, ...]
    """Of `MORE`, those that were measured of any run."""
    wall: str
    cpu: str
    static: str
    distractors: str
    seeds: int
    verdict: str
    is_on_front: bool
    is_base: bool


def write_report(folder: Path, results: Results) -> Path:
    """Draw the plots and write the report; where it is."""
    found = measured_of(results)
    plots = draw_all(folder, found)
    text = template(TEMPLATE).render(
        capture=results.capture,
        effects=effects_in_words(results.capture.effects),
        results=results,
        claims=claims_in_words(found),
        rows=training_rows(found, results),
        more=[MORE[name] for name in names_of(found)],
        within=best_by_time(found),
        reached=time_by_decibels(found),
        on_the_front=front_in_words(found),
        plots={name: inline_svg((folder / f"{name}.svg").read_text("utf8")) for name in plots},
        pictures=pictures_of(folder, found),
        code=short(results.code),
    )
    (folder / FILE).write_text(text, "utf8")
    return folder / FILE


def measured_of(results: Results) -> list[Measured]:
    """What its trainings say, in the order of the plan."""
    if results.plan is None:
        return []
    return measured(results.plan.runs(results.capture), results.training)


# --- training ------------------------------------------------------------------------------------


def training_rows(found: Sequence[Measured], results: Results) -> list[Row]:
    """Whole runs: the base's lengths first, then the other variants at the comparison's."""
    ends = sorted(finals(found), key=lambda one: (one.variant != BASE, one.steps))
    variants, front, said = compared(results.capture.effects), on_front(ends), verdicts(ends)
    return [
        Row(
            variants[one.variant].what,
            f"{one.steps:,}",
            spread(one.psnr, ".2f"),
            tuple(_figure(one, name, ".3f") for name in names_of(ends)),
            spread(one.wall, ".0f"),
            _figure(one, "train_cpu_seconds", ".0f"),
            _figure(one, "num_static_gaussians", ",.0f", alone=True),
            _figure(one, "num_distractor_gaussians", ",.0f", alone=True),
            len(one.seeds),
            said[index],
            index in front,
            one.variant == BASE,
        )
        for index, one in enumerate(ends)
    ]


def names_of(found: Sequence[Measured]) -> list[str]:
    """Those of `MORE` that were measured of any run."""
    return [name for name in MORE if any(name in one.figures for one in found)]


def spread(values: Spread, form: str) -> str:
    """Median, and the range of several seeds."""
    text = format(values.median, form)
    if len(values.values) == 1:
        return text
    return f"{text} ({values.least:{form}} to {values.most:{form}})"


def _figure(one: Measured, name: str, form: str, alone: bool = False) -> str:
    values = one.figures.get(name)
    if values is None:
        return ""
    return format(values.median, form) if alone else spread(values, form)


def best_by_time(found: Sequence[Measured]) -> list[dict[str, str]]:
    """The best of the defaults within some training times."""
    ours = [one for one in found if one.variant == BASE]
    rows = [(seconds, best_within(seconds, ours)) for seconds in times_to_tell(ours)]
    return [
        {"time": time_in_words(seconds), "psnr": spread(one.psnr, ".2f"), "run": _run_words(one)}
        for seconds, one in rows
        if one is not None
    ]


def time_by_decibels(found: Sequence[Measured]) -> list[dict[str, str]]:
    """How soon the defaults reached whole dB."""
    ours = [one for one in found if one.variant == BASE]
    rows = [(decibels, soonest_at(decibels, ours)) for decibels in decibels_to_tell(ours)]
    return [
        {"psnr": f"{decibels} dB", "time": spread(one.wall, ".0f") + " s", "run": _run_words(one)}
        for decibels, one in rows
        if one is not None
    ]


def _run_words(one: Measured) -> str:
    if one.is_final:
        return f"a run of {one.steps:,} steps"
    return f"after {one.done:,} of {one.steps:,} steps"


def claims_in_words(found: Sequence[Measured]) -> str:
    """What a claim of this page means, and what so few seeds cannot show."""
    said = verdicts(finals(found))
    number = sum(bool(words) and "no claim" not in words for words in said)
    ratio = f"{least_ratio(number):.0f} times" if number else "two and more times"
    return (
        "A difference is the mean, over seeds, of what a variant has less what the defaults have "
        f"with the same seed. It is claimed where all {NEEDED} seeds of both were measured and "
        f"p is at most {SIGNIFICANT:g}, by a paired t-test with Holm's correction for the number "
        f"of comparisons ({number} here): if no variant mattered, one such page in "
        f"{round(1 / SIGNIFICANT)} would claim any difference. To be claimed, the clearest one has "
        f"to be {ratio} as large as its scatter from seed to seed (standard deviation). The test "
        f"takes that scatter to be normally distributed, which {NEEDED} seeds cannot show; "
        "without it they tell nothing, for all three differences have the same sign by chance "
        'once in four times. "Not told apart" does not say that there is no difference; and seeds '
        "are of this capture alone: what holds here may not hold on another."
    )


def front_in_words(found: Sequence[Measured]) -> str:
    """Whether the defaults are worth their time, and what beats them if they are not."""
    ends = finals(found)
    if not ends:
        return ""
    front = on_front(ends)
    beaten = [o for i, o in enumerate(ends) if o.variant == BASE and i not in front]
    if not beaten:
        return "Every length of the defaults lies on the front."
    better = {ends[i].variant for i in front if ends[i].variant != BASE}
    lengths = ", ".join(f"{one.steps:,}" for one in sorted(beaten, key=lambda one: one.steps))
    return (
        f"The defaults at {lengths} steps lie behind the front, by medians. On it are also: "
        f"{', '.join(sorted(better)) or 'other lengths of the defaults alone'}. The table says "
        "what may be claimed of each."
    )


# --- words and pictures --------------------------------------------------------------------------


def effects_in_words(effects: Effects) -> str:
    """What is on."""
    on = {name: value for name, value in asdict(effects).items() if value not in (False, "off")}
    return ", ".join(k if v is True else f"{k} {v}" for k, v in on.items()) or "none"


def pictures_of(folder: Path, found: Sequence[Measured]) -> list[dict[str, str]]:
    """The first held-out photo beside its rendering, by the shortest and by the best run."""
    ends = [one for one in finals(found) if one.variant == BASE]
    if not ends:
        return []
    shortest = min(ends, key=lambda one: one.steps)
    best = max(ends, key=lambda one: one.psnr.median)
    shown = []
    for one in dict.fromkeys((shortest.steps, best.steps)):
        name = f"{BASE}-{one}-{SEEDS[0]}"
        found_pictures = sorted((folder / RUNS / name / PICTURES).glob("eval_img_*.png"))
        if found_pictures:
            pixels = np.asarray(Image.open(found_pictures[0]).convert("RGB"))
            data = data_address(pixels, PICTURE_SIDE, PICTURE_QUALITY, "JPEG")
            shown.append({"steps": f"{one:,}", "data": data})
    return shown
