"""Measure the catalogue of hard cases, kill a run, watch a long one, and break single lines.

    python -m lab.stability            (or: make stability; hours)
    python -m lab.stability --only catalogue mutations

What is found is printed, and written to outputs/stability.md. The exit status is 1 where a
case exceeds its bound, a kill lost more than it may, memory grew, or no test noticed a mutation.
"""

import sys
from collections.abc import Callable, Sequence

import torch

from desplat_ns.core.whole import write_whole
from lab import OUTPUTS, parser_of
from lab.machine import describe_machine
from lab.stability import catalogue, kills, mutations, soak

Part = Callable[[], tuple[str, bool]]
"""Gives what was found as Markdown, and whether all is as promised."""

PARTS: dict[str, Part] = {
    "catalogue": catalogue.measured,
    "kills": kills.measured,
    "mutations": mutations.measured,
    "soak": soak.measured,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = parser_of("python -m lab.stability", __doc__)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    chosen = parser.parse_args(arguments).only
    torch.set_num_threads(1)
    where = describe_machine()
    made = f"`make stability` at commit {where['Commit']}, {where['Date']}, on {where['Processor']}"
    texts, is_kept = [made], True
    OUTPUTS.mkdir(exist_ok=True)
    for name in chosen:
        text, is_good = PARTS[name]()
        is_kept &= is_good
        texts.append(f"## {name.capitalize()}\n\n{text}")
        print(texts[-1], flush=True)
        write_whole(OUTPUTS / "stability.md", ("\n\n".join(texts) + "\n").encode())
    return int(not is_kept)


if __name__ == "__main__":
    sys.exit(main())
