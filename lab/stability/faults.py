"""Kill a training run 20 times, and poison formulas, files and options; writes
docs/records/faults.json.

    python -m lab.stability.faults            (--quick --output somewhere: a check only)

The soak run beside it is `python -m lab.stability.soak`. `lab.stability` puts both
into docs/dev/stability.md.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch

from desplat_ns.studies.machine import describe_machine
from lab.arguments import parse_measurement, parser_of
from lab.documents import CHECKOUT, RECORDS

RECORD = "faults.json"
KILLS, INPUTS = 20, 200
"""Kills of one run; poisoned inputs for each formula, kind of file and set of options."""

FORMULAS = "formulas"
KINDS = ("finite", "refused", "culled", "fault")


def killed(kills: int) -> dict[str, Any]:
    """What became of a run that was killed so often, in a process of its own."""
    command = [sys.executable, "-m", "lab.stability.kills", str(kills)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=CHECKOUT)
    return json.loads(done.stdout.splitlines()[-1])


def fuzzed(inputs: int, seed: int = 0) -> dict[str, dict[str, int]]:
    """How many inputs ended how, by what they were put into."""
    from lab.stability import fuzz_files, fuzz_options
    from lab.stability.fuzz_formulas import FORMULAS as ALL

    rng = random.Random(seed)
    counts = {FORMULAS: Counter()}
    for formula in ALL:
        for _ in range(inputs):
            faults = formula.attempt(rng)
            counts[FORMULAS]["fault" if faults else "finite"] += 1
            print(*faults, end="\n" if faults else "")
    with tempfile.TemporaryDirectory() as folder:
        places = fuzz_files.write_healthy(Path(folder) / "healthy")
        for source in fuzz_files.SOURCES:
            counts[source.name] = _counted(
                inputs,
                lambda source=source: fuzz_files.fate_of(
                    source, rng, places[source.name], Path(folder) / "work"
                ),
            )
        for options in fuzz_options.all_options(places["COLMAP, binary"], Path(folder) / "run"):
            counts[f"options: {options.name}"] = _counted(
                inputs, lambda options=options: fuzz_options.fate_of(options, rng)
            )
    return {name: {kind: fates[kind] for kind in KINDS} for name, fates in counts.items()}


def _counted(inputs: int, attempt: Callable[[], str]) -> Counter:
    fates: Counter = Counter()
    for _ in range(inputs):
        fate = attempt()
        kind = {"fine": "finite"}.get(fate, fate)
        if kind not in KINDS:
            print(fate)
            kind = "fault"
        fates[kind] += 1
    return fates


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.stability.faults", __doc__)
    parser.add_argument("--only", choices=("fuzz", "killed"), help="keep the rest of the record")
    chosen = parse_measurement(parser, RECORDS, arguments)
    torch.set_num_threads(1)
    kills, inputs = (2, 3) if chosen.quick else (KILLS, INPUTS)
    path = chosen.output / RECORD
    record = json.loads(path.read_text()) if chosen.only else {}
    record["machine"] = describe_machine()
    if chosen.only != "killed":
        record["fuzz"] = fuzzed(inputs)
    if chosen.only != "fuzz":
        record["killed"] = killed(kills)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(path)


if __name__ == "__main__":
    main()
