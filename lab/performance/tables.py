"""The report's tables, in Markdown."""

from __future__ import annotations

from desplat_ns.calibration.scenes import PARAMETERS
from desplat_ns.calibration.timing import Timing
from lab.grid.tables import table
from lab.performance.distractors_price import CASES, OFF
from lab.performance.peak import FLOPS_BACKWARD, FLOPS_FORWARD
from lab.performance.results import Results
from lab.performance.serial_share import FORECAST, share_of, speedup
from lab.performance.targets import targets
from lab.performance.training_step import OTHER, PARTS
from lab.performance.yardstick import YARDSTICK
from lab.pixels.rasterizing import BLENDING, WHOLE


def milliseconds(value: float) -> str:
    """Three significant digits, at least."""
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def with_range(timing: Timing) -> str:
    """Median and, in brackets, least and largest CPU milliseconds."""
    low, high = map(milliseconds, timing.cpu_range)
    return f"{milliseconds(timing.cpu_ms)} ({low} - {high})"


def machine_table(results: Results) -> str:
    return table(["", "this run"], list(map(list, results.machine.items())))


def speed_table(results: Results, part: str) -> str:
    """Forward and forward + backward of everyone."""
    rows = [
        [
            r.scene,
            r.contender,
            str(r.threads),
            with_range(r.forward),
            milliseconds(r.forward.wall_ms),
            with_range(r.both),
            milliseconds(r.both.wall_ms),
            f"{results.speedup(r):.1f} x",
        ]
        for r in results.rows
        if r.part == part
    ]
    head = ["scene", "rasterizer", "threads", "forward, CPU ms", "wall ms"]
    return table([*head, "forward + backward, CPU ms", "wall ms", "yardstick / this"], rows)


def step_table(results: Results, scene: str, threads: int) -> str:
    """Parts of a step in CPU milliseconds and percent, one pair of columns per kind of step."""
    steps = [s for s in results.steps if (s.scene, s.threads) == (scene, threads)]
    rows = []
    for part in (*PARTS, OTHER):
        cells = [(s.parts[part], s.parts[part] / s.whole.cpu_ms) for s in steps]
        rows.append([part, *(c for ms, share in cells for c in (f"{ms:.1f}", f"{share:.0%}"))])
    total = [c for s in steps for c in (with_range(s.whole), "100%")]
    rows.append(["**uninterrupted step**", *total])
    rows.append(["its wall time", *(c for s in steps for c in (f"{s.whole.wall_ms:.1f}", ""))])
    slow = results.step(scene, YARDSTICK.name, threads).whole.cpu_ms
    rows.append(["yardstick / this", *(c for s in steps for c in (_ratio(slow, s.whole), ""))])
    title = f"{scene}, {threads} thread{'s' * (threads > 1)}, CPU ms"
    return table([title, *(c for s in steps for c in (s.name, ""))], rows)


def _ratio(slow: float, fast: Timing) -> str:
    return f"{slow / fast.cpu_ms:.1f} x"


def step_tables(results: Results) -> str:
    keys = dict.fromkeys((s.scene, s.threads) for s in results.steps)
    return "\n\n".join(step_table(results, *key) for key in keys)


def adam_table(results: Results) -> str:
    rows = [[scene, *map(with_range, kinds.values())] for scene, kinds in results.adam.items()]
    kinds = next(iter(results.adam.values()))
    return table(["Adam alone, CPU ms, 1 thread", *kinds], rows)


def memory_table(results: Results) -> str:
    if not results.memory:
        return "Not measured in a quick run."
    names = list(dict.fromkeys(name for _, name in results.memory))
    rows = []
    for scene in results.scenes:
        peaks = [results.memory.get((scene, name)) for name in names]
        rows.append([scene, *("n/a" if mib is None else f"{mib:,.0f}" for mib in peaks)])
    return table(["MiB", *names], rows)


def error_table(results: Results) -> str:
    rows = [
        [
            e.scene,
            e.contender,
            f"{e.largest:.1e}",
            f"{e.flipped:.1e}",
            f"{e.largest_unflipped:.1e}",
            *(f"{e.gradients[name]:.1e}" for name in PARAMETERS),
        ]
        for e in results.errors
    ]
    head = ["scene", "rasterizer", "RGB, largest", "flipped pixels", "RGB, the others"]
    return table([*head, *PARAMETERS], rows)


def pair_table(results: Results) -> str:
    rows = []
    for scene, p in results.pairs.items():
        numbers = (p.square, p.listed, p.evaluated, p.contributing)
        rows.append(
            [scene, *(f"{n / 1e6:.3g}" for n in numbers), f"{p.contributing / p.evaluated:.0%}"]
        )
    head = ["million pairs", "3-sigma squares", "exact lists", "evaluated", "contributing"]
    return table([*head, "of those evaluated"], rows)


def peak_table(results: Results) -> str:
    rates = ", ".join(f"{bits} bits: {rate:.0f}" for bits, rate in results.peaks.items())
    rows = []
    for scene, p in results.pairs.items():
        for name, backward, flops in (
            ("forward", False, FLOPS_FORWARD),
            ("backward", True, FLOPS_BACKWARD),
        ):
            cells = []
            for pairs in (p.evaluated, p.contributing):
                rate = results.gflops(scene, pairs, backward, flops)
                cells += [f"{rate:.1f}", f"{rate / results.peak:.1%}"]
            rows.append([f"{scene}, {name}", str(flops), *cells])
    head = ["numba, blending alone", "flop / pair", "GFLOP/s, evaluated", "of the peak"]
    text = table([*head, "GFLOP/s, contributing", "of the peak"], rows)
    return f"Peak of one core, GFLOP/s by width of the vectors: {rates}.\n\n{text}"


def growth_table(results: Results) -> str:
    rows = [
        [
            p.series,
            f"{p.count:,}",
            f"{p.width} x {p.height}",
            with_range(p.timing),
            f"{1e6 * p.timing.cpu_ms / p.count:.0f}",
            f"{1e6 * p.timing.cpu_ms / (p.width * p.height):.0f}",
        ]
        for p in results.growth
    ]
    head = ["", "Gaussians", "pixels", "CPU ms", "ns per Gaussian", "ns per pixel"]
    return table(head, rows)


def price_table(results: Results) -> str:
    """Steps with distractors over those without: CPU time and, in brackets, wall time."""
    rows = []
    for p in results.prices:
        off, ratios = p.steps[OFF], [p.ratios(case) for case in CASES]
        times = f"{milliseconds(off.cpu_ms)} ({milliseconds(off.wall_ms)})"
        cells = [f"{cpu:.2f} ({wall:.2f})" for cpu, wall in ratios]
        rows.append([p.scene, str(p.threads), times, *cells])
    return table(["photo, Gaussians", "threads", "off, CPU (wall) ms", *CASES], rows)


def serial_table(results: Results) -> str:
    """Whole steps on one thread and on all, and what that forecasts."""
    if not results.serial:
        return "Not measured: there is one core."
    rows = [
        [
            f"{s.scene}, {s.kind}",
            *(milliseconds(s.whole[n].wall_ms) for n in (1, s.threads)),
            f"{s.cores_used:.2f} of {s.threads}",
            f"{s.share:.0%}",
            *(f"{speedup(s.share, n):.1f} x" for n in FORECAST),
        ]
        for s in results.serial
    ]
    most = results.serial[0].threads
    head = ["photo, Gaussians", "1 thread, ms", f"{most} threads", "cores used", "serial share"]
    return table([*head, *(f"at {n}" for n in FORECAST)], rows)


def serial_parts(results: Results) -> str:
    """The parts of the steps of `serial_table`."""
    tables = []
    for s in results.serial:
        single, many = s.parts[1], s.parts[s.threads]
        rows = []
        for part, ms in single.items():
            share = f"{share_of(ms, many[part], s.threads):.0%}" if ms > 0 else ""
            cells = (f"{ms:.1f}", f"{ms / sum(single.values()):.0%}", f"{many[part]:.1f}", share)
            rows.append([part, *cells])
        title = f"{s.scene}, {s.kind}, wall ms"
        head = [title, "1 thread", "of the step", f"{s.threads} threads", "serial share"]
        tables.append(table(head, rows))
    return "\n\n".join(tables)


def target_table(results: Results) -> str:
    rows = [[t.text, t.measured, "yes" if t.met else "**no**"] for t in targets(results)]
    return table(["target (1 thread, CPU time)", "measured", "met"], rows)


def missing_list(results: Results) -> str:
    lines = [f"- Not measured: `{name}` {reason}" for name, reason in results.missing.items()]
    return "\n".join(lines) or "- Every registered backend was measured."


def all_tables(results: Results) -> dict[str, str]:
    """By their names in the template."""
    return {
        "machine": machine_table(results),
        "missing": missing_list(results),
        "pairs": pair_table(results),
        "whole_calls": speed_table(results, WHOLE),
        "blending": speed_table(results, BLENDING),
        "steps": step_tables(results),
        "adam": adam_table(results),
        "memory": memory_table(results),
        "errors": error_table(results),
        "peak": peak_table(results),
        "growth": growth_table(results),
        "price": price_table(results),
        "serial": serial_table(results),
        "serial_parts": serial_parts(results),
        "targets": target_table(results),
    }
