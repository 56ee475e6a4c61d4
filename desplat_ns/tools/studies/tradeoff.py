"""`desplat-tradeoff`: what accuracy costs in time. All variants are trained for a few steps, then
for twice as many, and so on while time is left. Ended at any time, a study goes on where it was."""

import base64
import io
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure

from desplat_ns.backend.registry import compile_kernels, default_device
from desplat_ns.core.effects import AppearanceGrade, Effects
from desplat_ns.core.errors import ConfigError, DeSplatError
from desplat_ns.core.pages import template
from desplat_ns.core.whole import only_process_in, write_output
from desplat_ns.survey.survey import decided_effects
from desplat_ns.tools.studies.methods import content_of, method_config, splits_of
from desplat_ns.tools.studies.records import Key, Record, conditions_of, open_records
from desplat_ns.tools.studies.runs import Run, finish

BASE = "desplat"
"""The method whose options are varied, and its variant of all defaults."""
SEEDS = (42, 43, 44)
SHORTEST = 125
"""Steps of the first runs. Later ones have these, doubled some times."""
GROWTH = 1.5
"""What a step of a longer run is expected to take, of one of the first: Gaussians grow."""
GRADES: tuple[AppearanceGrade, ...] = ("off", "camera", "affine")

TEMPLATE = Path(__file__).with_name("page.html.jinja")
COLUMNS = {
    "psnr": ("PSNR, dB", ".2f"),
    "ssim": ("SSIM", ".3f"),
    "lpips": ("LPIPS", ".3f"),
    "mask_iou": ("mask IoU", ".3f"),
    "train_wall_seconds": ("wall, s", ".0f"),
    "train_cpu_seconds": ("CPU, s", ".0f"),
    "num_static_gaussians": ("static", ",.0f"),
    "num_distractor_gaussians": ("distractors", ",.0f"),
}
"""Scores in the table: their names there, and how they are written."""
MARKERS = "osD^vPXhd"
Scores = Mapping[int, Mapping[str, Any]]
"""By seed."""
Point = tuple[str, int]
"""A variant and a length."""


@dataclass
class Study:
    """The work on a study from one start of the command to its end."""

    data: Path
    """The capture's folder, absolute."""
    parser: tuple[str, ...]
    """The data parser's name and options, as `ns-train` takes them; empty for the method's own."""
    content: str
    """What the data parser finds, in words."""
    effects: Effects
    """Which the capture calls for, as a survey decided."""
    output: Path
    seconds: float
    """Of wall time, for the whole study."""
    records: dict[Key, Record]
    failed: dict[str, str] = field(default_factory=dict)
    """Why a run has no record, by its name."""

    def __post_init__(self) -> None:
        self.planned = self.plan(method_config(BASE).nominal_num_iterations)
        earlier = sum(record.seconds for record in self.records.values())
        self._began = time.monotonic() - earlier

    @property
    def spent(self) -> float:
        """Seconds of wall time. Of earlier sessions those of the runs count."""
        return time.monotonic() - self._began

    def plan(self, most: int) -> list[Run]:
        """All runs, none longer than `most` steps, in the order in which they are done: every
        variant at one length after the other, then the longest ones with other seeds first."""
        lengths = [SHORTEST]
        while 2 * lengths[-1] <= most:
            lengths.append(2 * lengths[-1])
        rounds = [(steps, SEEDS[0]) for steps in lengths]
        rounds += [(steps, seed) for steps in reversed(lengths) for seed in SEEDS[1:]]
        return [
            Run(name, BASE, options, steps, seed, self.data, self.parser)
            for steps, seed in rounds
            for name, (_, options) in compared(self.effects).items()
        ]

    def expected(self, run: Run) -> float:
        """Wall seconds of a run, by the longest one of its variant that is done, or of the base:
        all but the steps takes as long as there, each step as long as one there."""
        done = [each for each in self.planned if each.key in self.records]
        alike = [each for each in done if each.variant == run.variant]
        base = [each for each in done if each.variant == BASE]
        known = max(alike or base, key=lambda each: each.steps)
        record = self.records[known.key]
        training = record.scores["train_wall_seconds"]
        growth = GROWTH if run.steps > known.steps == SHORTEST else 1.0
        return record.seconds - training + run.steps * growth * training / known.steps

    def fitting(self) -> Iterator[Run]:
        """The planned runs that are not done, in order, that are expected to end in time when they
        are asked for. One that does not fit is passed over: shorter ones behind it may."""
        for run in self.planned:
            if run.key not in self.records and self.expected(run) <= self.seconds - self.spent:
                yield run

    def left(self) -> str:
        """How much of the time is spent, in words."""
        return f"Spent: {self.spent / 60:.0f} of {self.seconds / 60:.0f} min."

    def do(self) -> None:
        """Do the runs that are not done and for which time is left. Raises DeSplatError where the
        first run failed, ConfigError where records cannot be written."""
        how = self.records, self.output, self.left
        for failure in finish(self.planned[:1], *how).values():
            raise DeSplatError(f"The first run failed. {failure}")
        self.failed = finish(self.fitting(), *how)


def tradeoff(data: Path, parser: tuple[str, ...], output: Path, seconds: float) -> Path:
    """Do a study as far as its time goes, earlier sessions included, and write its page; where that
    is. Raises as `open_study` and `Study.do`."""
    with only_process_in(output):
        compile_kernels("auto", default_device())  # no part of the time that was given
        study = open_study(data, parser, output, seconds)
        study.do()
        return write_page(study)


def open_study(data: Path, parser: tuple[str, ...], output: Path, seconds: float) -> Study:
    """What an output folder holds of the study of a capture, or a new one; the capture is surveyed.
    Raises CaptureError where nothing is held out, ConfigError where the folder has another one."""
    records, data = open_records(output), data.resolve()
    for record in records.values():
        if record.capture != str(data):
            raise ConfigError(
                f"'{output}' holds the study of '{record.capture}'. Name another --output."
            )
    train, test = splits_of(BASE, data, parser, "train", "test")
    effects = decided_effects(method_config(BASE).pipeline.model.effects, train)[0].settled()
    content = content_of(train, test)
    return Study(data, parser, content, effects, output, seconds, records)


def compared(base: Effects) -> dict[str, tuple[str, tuple[str, ...]]]:
    """What is compared, by name: in what it differs from the defaults, in words, and its options.
    First the base, with the effects that the capture calls for; each other one differs from it in
    one thing. All are scored on right halves: the left half shows a photo's own light."""

    def variant(what: str, effects: Effects = base, **options: str) -> tuple[str, tuple[str, ...]]:
        given = {
            "model.effects.auto": "False",
            "model.effects.distractors": str(effects.distractors),
            "model.effects.appearance": effects.appearance,
            "model.effects.background": effects.background,
            "evaluation.protocol": "half" if effects.image_light else "right",
            **{f"model.{name.replace('_', '-')}": value for name, value in options.items()},
        }
        return what, tuple(w for k, v in given.items() for w in (f"--pipeline.{k}", v))

    with_or_without = "without" if base.distractors else "with"
    background = "constant" if base.background == "off" else "off"
    return {
        BASE: variant("the defaults"),
        "half-size": variant("photos of half their size", train_downscale="2"),
        "fewer": variant("a quarter of the static Gaussians", gaussians_per_pixel="0.0125"),
        "degree-1": variant("spherical harmonics of degree 1", sh_degree="1"),
        "distractors": variant(
            f"{with_or_without} distractors", replace(base, distractors=not base.distractors)
        ),
        **{
            f"appearance-{grade}": variant(f"appearance {grade}", replace(base, appearance=grade))
            for grade in GRADES
            if grade != base.appearance
        },
        "background": variant(f"background {background}", replace(base, background=background)),
    }


def measured(study: Study) -> Mapping[Point, Scores]:
    """What has a record of at least one seed, the shortest first."""
    points = dict[Point, dict[int, Mapping[str, Any]]]()
    for run in sorted(study.planned, key=lambda run: run.steps):
        if (record := study.records.get(run.key)) is not None:
            points.setdefault((run.variant, run.steps), {})[run.seed] = record.scores
    return points


def values(scores: Scores, name: str) -> list[float | int]:
    """A score of each seed that has it."""
    return [row[name] for row in scores.values() if name in row]


def gain(points: Mapping[Point, Scores], point: Point) -> str:
    """PSNR of a point less the base's at as many steps, seed by seed, by `spread`; empty where
    there is nothing to compare it with."""
    variant, steps = point
    base = {} if variant == BASE else points.get((BASE, steps), {})
    scores = points[point]
    return spread([scores[s]["psnr"] - base[s]["psnr"] for s in scores if s in base], "+.2f")


def write_page(study: Study) -> Path:
    """Write the page; where it is. Raises ConfigError where it cannot."""
    page, points = study.output / "report.html", measured(study)
    text = template(TEMPLATE, spread=spread, values=values).render(
        study=study,
        columns=COLUMNS,
        variants=compared(study.effects),
        points=points,
        gains={point: gain(points, point) for point in points},
        plot=drawn(points),
        conditions=conditions_of(study.records.values()),
    )
    write_output(page, text.encode())
    return page


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and the range of several values; empty where there is none."""
    if not values:
        return ""
    text = f"{median(values):{form}}"
    return f"{text} ({min(values):{form}} to {max(values):{form}})" if len(values) > 1 else text


def drawn(points: Mapping[Point, Scores]) -> str:
    """PSNR over the training time, a mark for each training, as the address of a PNG."""
    figure = Figure(figsize=(6.6, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.grid(True, alpha=0.25)
    axes.set(xlabel="training time, s of wall time", ylabel="PSNR of right halves, dB")
    axes.set_xscale("log")
    for variant, marker in zip(dict.fromkeys(name for name, _ in points), cycle(MARKERS)):
        mine = [scores for (name, _), scores in points.items() if name == variant]
        x = [value for scores in mine for value in values(scores, "train_wall_seconds")]
        y = [value for scores in mine for value in values(scores, "psnr")]
        axes.plot(x, y, marker, alpha=0.6, label=variant)
    axes.legend(frameon=False, fontsize=8, ncols=2)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=150)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
