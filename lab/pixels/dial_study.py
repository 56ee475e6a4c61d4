"""Accuracy against time for every backend and every dial, within so many seconds.

One dial at a time is turned away from today's setting. Each such drawing is compared with the truth
of its group (`dial_errors`), then all are timed in turns, on one thread. What would not fit into
the time is left out, and the result says why: fast backends come first. On a busy machine times are
noisy: the ranges and `dial_points.excess` say how much a place on the front is worth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import cache

import torch

from desplat_ns.calibration.scenes import Scene, make_scene
from desplat_ns.calibration.timing import threads
from lab.pixels.appearance_dial import MLP_DTYPES, bfloat16_unavailable_reason, toning
from lab.pixels.budgeted_turns import (
    FORWARD_SHARE,
    Budget,
    Case,
    due_seconds,
    take_turns,
)
from lab.pixels.contenders import Contender, backends
from lab.pixels.dial_errors import Drawing, Drawn, errors_of
from lab.pixels.dial_points import (
    ANTIALIASING,
    APPEARANCE,
    RASTERIZING,
    DialStudy,
    Label,
    LeftOut,
    marked,
)
from lab.pixels.dials import (
    ANTIALIASED,
    DIALS,
    EXACT,
    SUPERSAMPLED,
    TODAY,
    Setting,
    unavailable_reason,
)
from lab.pixels.memory import TINY
from lab.pixels.rasterizing import Cases

FINER_COST = 16
"""Seconds of the supersampled truth over those of today's picture, which has a 16th of the pixels:
lists are longer, but a Gaussian fills more of a tile."""

FINER_SHARE = 0.25
"""Of the time left that the supersampled truth may take: it serves one dial."""


def measure_dials(scene: Scene, seconds: float, tell: Callable[[str], None]) -> DialStudy:
    """Time and error of every backend with every dial, on one scene.

    The limits of this process's backends change meanwhile: see `dials`.

    Args:
        seconds: how long it may take, once kernels are compiled; one call more at most.
        tell: gets a line about every case.
    """
    contenders, missing = backends()
    for contender in contenders:
        tiny = make_scene(*TINY)
        Drawing(contender, tiny, TODAY, tiny.splats).drawn()  # compiles what has to be
    with threads(1):
        run = _Run(scene, seconds, tell)
        run.make_truths(contenders)
        run.admit_appearance()
        for contender in contenders:
            run.admit_contender(contender, is_default=contender is contenders[0])
        run.take_turns()
    for name, reason in missing.items():
        run.leave_out([Label(RASTERIZING, "backend", name, name)], reason)
    points = marked([point for case in run.cases if case.turns > 0 for point in case.points()])
    return DialStudy(scene.name, run.budget.spent, points, run.left_out)


class _Run:
    """One study as it goes on."""

    def __init__(self, scene: Scene, seconds: float, tell: Callable[[str], None]) -> None:
        self.scene, self.tell = scene, tell
        self.budget = Budget(seconds)
        self.cases: list[Case] = []
        self.left_out: list[LeftOut] = []
        self._leaves = cache(scene.splats)
        self._truths: dict[str, Drawn] = {}
        self._seconds: dict[str, float] = {}
        """Of a forward + backward with today's setting, by backend."""

    def make_truths(self, contenders: list[Contender]) -> None:
        """Those of both groups of drawings; no supersampled one if it would take too long."""
        by_name = {contender.name: contender for contender in contenders}
        drawing = self._drawing(by_name["torch"], EXACT)
        self._truths[RASTERIZING], seconds = _seconds_of(drawing.drawn)
        self._seconds["torch"] = seconds / 2  # float64 moves twice as many bytes
        self.tell(f"truth: {seconds:.1f} s")
        sampler = by_name.get("numba", by_name["torch"])
        seconds = FINER_COST * _seconds_of(self._drawing(sampler, TODAY).drawn)[1]
        if seconds <= FINER_SHARE * self.budget.left:
            drawing = self._drawing(sampler, SUPERSAMPLED)
            self._truths[ANTIALIASING], seconds = _seconds_of(drawing.drawn)
            self.tell(f"supersampled truth: {seconds:.1f} s")

    def admit_appearance(self) -> None:
        """The appearance network with each dtype of its products."""
        if self.budget.left > 0:
            self._truths[APPEARANCE] = toning(self.scene, None).drawn()
        for products in MLP_DTYPES:
            label = Label(APPEARANCE, "MLP dtype", products, "torch")
            reason = bfloat16_unavailable_reason() if products == "bfloat16" else None
            if reason is not None:
                self.leave_out([label], reason)
                continue
            work = toning(self.scene, products)
            is_default = products == "float32"
            self._admit([label], is_default, "CPU", 0.0, work.drawn, work.timed)

    def admit_contender(self, contender: Contender, is_default: bool) -> None:
        """A backend with today's setting, then with every other."""
        name = contender.name
        off = Label(ANTIALIASING, ANTIALIASED.dial, "off", name)
        labels = [Label(RASTERIZING, "backend", name, name), off]
        seconds = self._admit_drawing(labels, contender, TODAY, is_default)
        self._seconds[name] = seconds or self._seconds.get(name, 0.0)
        for position in DIALS:
            label = Label(RASTERIZING, position.dial, position.value, name)
            self._admit_drawing([label], contender, position.setting)
        label = Label(ANTIALIASING, ANTIALIASED.dial, ANTIALIASED.value, name)
        self._admit_drawing([label], contender, ANTIALIASED.setting)

    def take_turns(self) -> None:
        """Time all cases, as long as there is time."""
        take_turns(self.cases, self.budget)
        for case in self.cases:
            if case.turns == 0:
                self.leave_out(case.labels, "the time was over before its first turn")

    def leave_out(self, labels: Sequence[Label], reason: str) -> None:
        """Note why points are not measured."""
        for label in labels:
            self.left_out.append(LeftOut(**vars(label), reason=reason))
            self.tell(f"{label}: left out, {reason}")

    def _drawing(self, contender: Contender, setting: Setting) -> Drawing:
        return Drawing(contender, self.scene, setting, self._leaves)

    def _admit_drawing(
        self,
        labels: Sequence[Label],
        contender: Contender,
        setting: Setting,
        is_default: bool = False,
    ) -> float | None:
        """Seconds of one forward + backward, None if it is left out."""
        reason = unavailable_reason(contender, setting)
        if reason is not None:
            return self.leave_out(labels, reason)
        expected = self._seconds.get(contender.name, 0.0) * setting.scale
        expected *= 2 if setting.dtype == torch.float64 else 1
        clock = "CPU" if contender.device == "cpu" else "wall"
        work = self._drawing(contender, setting)
        return self._admit(labels, is_default, clock, expected, work.drawn, work.timed)

    def _admit(
        self,
        labels: Sequence[Label],
        is_default: bool,
        clock: str,
        expected: float,
        draw: Callable[[], Drawn],
        timed: Callable[[], Cases],
    ) -> float | None:
        """Draw a case for its errors and have it timed later, if it fits; see `_admit_drawing`."""
        self.leave_out([x for x in labels if x.group not in self._truths], "no time for its truth")
        labels = [x for x in labels if x.group in self._truths]
        if not labels:
            return None
        reason = self.budget.unavailable_reason(expected, due_seconds(self.cases))
        if reason is not None:
            return self.leave_out(labels, reason)
        drawn, seconds = _seconds_of(draw)
        errors = [errors_of(drawn, self._truths[label.group]) for label in labels]
        both = (1 + FORWARD_SHARE) * seconds
        self.cases.append(Case(labels, is_default, clock, errors, timed(), both))
        for label, error in zip(labels, errors, strict=True):
            self.tell(f"{label}: off by {error.picture:.1e}, gradients by {error.gradient:.1e}")
        return seconds


def _seconds_of(draw: Callable[[], Drawn]) -> tuple[Drawn, float]:
    since = time.perf_counter()
    drawn = draw()
    return drawn, time.perf_counter() - since
