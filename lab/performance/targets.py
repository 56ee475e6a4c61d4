"""What the `numba` backend is to reach, and whether it does."""

from __future__ import annotations

from dataclasses import dataclass

from lab.performance.peak import FLOPS_FORWARD
from lab.performance.results import Results
from lab.performance.training_step import DRAW, OTHER, PULL
from lab.performance.yardstick import YARDSTICK
from lab.performance.yardstick_squares import SQUARES
from lab.pixels.accuracy import FLIP_BUDGET
from lab.pixels.rasterizing import BLENDING, WHOLE

SPEEDUP, STRETCH, STEP_SPEEDUP = 35, 60, 15
"""Times as fast as the yardstick; the whole step against the one with the yardstick."""

FMA_SHARE, PART_SHARE = 0.10, 0.30
"""Of the peak, counting contributing pairs alone; of a step, for any part but the rasterizer."""


@dataclass(frozen=True)
class Target:
    """One line of the table."""

    text: str
    measured: str
    met: bool


def targets(results: Results) -> list[Target]:
    """All targets, with what was measured on one thread."""
    entries = []
    for scene in results.scenes:
        for part in (BLENDING, WHOLE):
            speedup = results.speedup(results.row(scene, "numba", part))
            for goal, kind in ((SPEEDUP, ""), (STRETCH, " (stretch)")):
                text = f"{scene}: forward + backward, {part}, at least {goal} x{kind}"
                entries.append(Target(text, f"{speedup:.1f} x", speedup >= goal))
        entries += _against_squares(results, scene)
        entries += [
            _in_step(results, scene),
            _fma_share(results, scene),
            *_step(results, scene),
            _flips(results, scene),
        ]
    return entries


def _against_squares(results: Results, scene: str) -> list[Target]:
    """Where the yardstick on gsplat's squares took part."""
    ours = results.row(scene, "numba", BLENDING).both.cpu_ms
    text = f"{scene}: blending alone, at least {SPEEDUP} x the yardstick on gsplat's squares"
    ratios = [
        row.both.cpu_ms / ours
        for row in results.rows
        if (row.scene, row.contender, row.part, row.threads) == (scene, SQUARES.name, BLENDING, 1)
    ]
    return [Target(text, f"{ratio:.1f} x", ratio >= SPEEDUP) for ratio in ratios]


def _in_step(results: Results, scene: str) -> Target:
    """Blending within a training step, whose memory is in use already."""
    ms = [
        sum(results.step(scene, name).parts[part] for part in (DRAW, PULL))
        for name in (YARDSTICK.name, "numba")
    ]
    text = f"{scene}: draw + pull of a training step, at least {SPEEDUP} x"
    return Target(text, f"{ms[0] / ms[1]:.1f} x", ms[0] / ms[1] >= SPEEDUP)


def _fma_share(results: Results, scene: str) -> Target:
    pairs = results.pairs[scene].contributing
    share = results.gflops(scene, pairs, False, FLOPS_FORWARD) / results.peak
    text = f"{scene}: forward, contributing pairs, at least {FMA_SHARE:.0%} of the peak (stretch)"
    return Target(text, f"{share:.1%}", share >= FMA_SHARE)


def _step(results: Results, scene: str) -> list[Target]:
    step = results.step(scene, "numba")
    speedup = results.step(scene, YARDSTICK.name).whole.cpu_ms / step.whole.cpu_ms
    others = {k: v / step.whole.cpu_ms for k, v in step.parts.items() if k not in (DRAW, PULL)}
    largest = max(others, key=lambda part: others[part])
    explained = step.share_explained
    return [
        Target(
            f"{scene}: whole training step at least {STEP_SPEEDUP} x",
            f"{speedup:.1f} x",
            speedup >= STEP_SPEEDUP,
        ),
        Target(
            f"{scene}: no part but the rasterizer over {PART_SHARE:.0%} of the step",
            f"{others[largest]:.0%} ({largest})",
            others[largest] <= PART_SHARE,
        ),
        Target(
            f"{scene}: the parts add up to the uninterrupted step within 10%",
            f"{explained:.0%} ({OTHER}: {step.parts[OTHER]:.1f} ms)",
            abs(1 - explained) <= 0.1,
        ),
    ]


def _flips(results: Results, scene: str) -> Target:
    (errors,) = (e for e in results.errors if (e.scene, e.contender) == (scene, "numba"))
    text = f"{scene}: at most {FLIP_BUDGET:g} of the pixels flip at a threshold"
    return Target(text, f"{errors.flipped:.1e}", errors.flipped <= FLIP_BUDGET)
