"""Measure everything and write the report.

python -m lab.performance            (or: make bench; BENCH_ARGS='--quick --output somewhere')
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from desplat_ns.calibration.scenes import Scene, make_scene
from desplat_ns.calibration.timing import thread_counts
from desplat_ns.studies.machine import describe_machine
from lab.arguments import parse_measurement, parser_of
from lab.documents import RESULTS
from lab.performance.distractors_price import SIZES as PRICED
from lab.performance.distractors_price import time_price
from lab.performance.pairs import count_pairs
from lab.performance.peak import peak_rates
from lab.performance.report import write_report
from lab.performance.results import Results
from lab.performance.serial_share import SIZES as SERIAL
from lab.performance.serial_share import time_serial
from lab.performance.steps import time_adam, time_steps
from lab.performance.yardstick import YARDSTICK
from lab.performance.yardstick_squares import SQUARES
from lab.pixels.accuracy import measure_errors
from lab.pixels.contenders import Contender, backends
from lab.pixels.growth import measure_growth
from lab.pixels.memory import measure_peak
from lab.pixels.rasterizing import time_rasterizers

SIZES = {(20_000, 480, 270): (6, 5), (100_000, 648, 420): (6, 3)}
"""Gaussians, width, height; and how many turns every case has, and every slow one."""

SQUARES_UP_TO = 50_000
"""Gaussians. The yardstick on squares would take 7 GiB for 100,000."""

QUICK_SIZES = {(500, 64, 48): (1, 1)}

_started = time.perf_counter()


def say(text: str) -> None:
    """Print what is measured now, with the seconds so far."""
    print(f"[{time.perf_counter() - _started:4.0f} s] {text}", flush=True)


def measure(quick: bool) -> Results:
    """The whole run."""
    runnable, missing = backends()
    everyone = [YARDSTICK, *runnable]
    results = Results(describe_machine(), missing)
    say("peak of a core")
    results.peaks = peak_rates(0.02 if quick else 0.5)
    for size, rounds in (QUICK_SIZES if quick else SIZES).items():
        measure_scene(results, make_scene(*size), everyone, rounds)
        if quick:
            continue
        for contender in (c for c in everyone if c.device == "cpu"):
            say(f"{results.scenes[-1]}: peak memory of {contender.name}")
            results.memory[results.scenes[-1], contender.name] = measure_peak(contender, size)
    say("growth")
    (grown,) = (c for c in everyone if c.name == "numba")
    results.growth = measure_growth(grown, 1 if quick else 5, quick)
    measure_model(results, quick)
    return results


def measure_model(results: Results, quick: bool) -> None:
    """Steps of the whole model: what distractors add, and what is serial."""
    small, numbers = tuple(QUICK_SIZES), thread_counts()
    for size in small if quick else PRICED:
        say(f"{size[0]:,} Gaussians, {size[1]} x {size[2]}: the price of distractors")
        results.prices += time_price(size, 1 if quick else 5, numbers)
    for size in (small if quick else SERIAL) if len(numbers) > 1 else ():
        say(f"{size[0]:,} Gaussians, {size[1]} x {size[2]}: what is serial")
        results.serial += time_serial(size, 1 if quick else 15, numbers[-1])


def measure_scene(
    results: Results, scene: Scene, everyone: list[Contender], rounds: tuple[int, int]
) -> None:
    """All that needs no process of its own."""
    results.scenes.append(scene.name)
    say(f"{scene.name}: pairs")
    results.pairs[scene.name] = count_pairs(scene)
    say(f"{scene.name}: errors")
    results.errors += measure_errors(scene, everyone)
    small = len(scene.params["means"]) <= SQUARES_UP_TO
    racers = [*everyone, SQUARES] if small else everyone
    for number in thread_counts():
        say(f"{scene.name}: rasterizers, threads: {number}")
        results.rows += time_rasterizers(scene, racers, number, rounds)
        say(f"{scene.name}: training steps, threads: {number}")
        results.steps += time_steps(scene, everyone, number, rounds)
    results.adam[scene.name] = time_adam(scene, rounds[0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.performance", __doc__)
    chosen = parse_measurement(parser, RESULTS, arguments)
    path = write_report(measure(chosen.quick), chosen.output)
    say(f"written: {path}")
