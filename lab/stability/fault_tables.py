"""What docs/dev/stability.md says of docs/records/faults.json and docs/records/soak.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lab.grid.tables import table
from lab.stability import faults, soak


def fault_figures(folder: Path) -> dict[str, str]:
    """Values for the template, from the records in `folder`."""
    record = json.loads((folder / faults.RECORD).read_text())
    return {
        **kill_figures(record["killed"]),
        "fuzz_faults": fuzz_table(record["fuzz"]),
        "fuzz_inputs": f"{sum(sum(fates.values()) for fates in record['fuzz'].values()):,}",
        "fault_machine": machine_line(record["machine"]),
        **soak_figures(soak.load(folder / soak.RECORD)),
    }


def kill_figures(killed: dict[str, Any]) -> dict[str, str]:
    """One row for each kill, and the sums."""
    kills = killed["kills"]
    lost = [kill["steps_done"] - kill["steps_kept"] for kill in kills]
    moments = [
        "while a checkpoint was written" if kill["while_saving"]
        else "in training" if kill["training"] else "while it loaded"
        for kill in kills
    ]  # fmt: skip
    rows = [
        [str(i), moment, str(kill["steps_done"]), str(kill["steps_kept"]), str(gone)]
        for i, (moment, kill, gone) in enumerate(zip(moments, kills, lost, strict=True), 1)
    ]
    return {
        "kills": table(["kill", "moment", "steps done", "steps kept", "lost"], rows),
        "num_kills": str(len(kills)),
        "most_lost": str(max(lost)),
        "all_lost": str(sum(lost)),
        "kill_steps": str(killed["steps"]),
        "kill_save": str(killed["steps_per_save"]),
        "kill_damaged": str(killed["damaged"]),
        "kill_files": str(killed["most_files"]),
        "kill_bits": "to the last bit" if killed["same_bits"] else "NOT to the last bit",
    }


def fuzz_table(fuzz: dict[str, dict[str, int]]) -> str:
    """One row for each thing that was poisoned."""
    rows = [
        [name, f"{sum(fates.values()):,}", *(f"{fates[kind]:,}" for kind in faults.KINDS)]
        for name, fates in fuzz.items()
    ]
    heads = [
        "finite",
        "refused with a message",
        "culled, or another taken, with a message",
        "faults",
    ]
    return table(["", "inputs", *heads], rows)


def soak_figures(result: soak.Soak) -> dict[str, str]:
    """Ten rows of the long run, and its verdict."""
    samples = result.samples[:: max(1, len(result.samples) // 10)]
    if samples[-1] is not result.samples[-1]:
        samples.append(result.samples[-1])
    rows = [
        [f"{s.step:,}", f"{s.rss:.1f}", f"{s.objects:,}", f"{s.gaussians:,}", f"{s.distractors:,}"]
        for s in samples
    ]
    heads = ["step", "resident, MiB", "Python objects", "static Gaussians", "distractors"]
    return {
        "soak": table(heads, rows),
        "soak_verdict": soak.describe(result),
        "soak_machine": machine_line(result.machine),
    }


def machine_line(machine: dict[str, str]) -> str:
    """Where it ran, in a line."""
    names = ("Processor", "Memory", "System", "Python", "torch", "numba", "Date")
    return ", ".join(f"{name} {machine[name]}" for name in names if name in machine)
