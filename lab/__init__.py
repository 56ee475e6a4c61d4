"""The laboratory: what the project measures for itself. Only a checkout has it.

Scenes with known truth (`synthetic`), studies whose figures stand in `docs/`, checks of machines
and GPUs. It imports `desplat_ns`, which imports nothing of it.
"""

import argparse
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

# Before anything loads OpenMP: waiting threads that spin would be counted as work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

CHECKOUT = Path(__file__).resolve().parents[1]
DOCS = CHECKOUT / "docs"
OUTPUTS = CHECKOUT / "outputs"
"""What studies train, a folder each; git ignores it."""


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """A parser whose help shows a module's docstring as it stands."""
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(program, description=description, formatter_class=formatter)


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "") -> str:
    """A Markdown table with `l` or `r` for each column, by default `l` for the first, `r` for all
    others. Bars within cells are escaped."""
    align = align or "l" + "r" * (len(head) - 1)
    rule = ["---" if side == "l" else "---:" for side in align]
    cells = ([cell.replace("|", "\\|") for cell in row] for row in (head, *rows))
    first, *others = (f"| {' | '.join(row)} |" for row in cells)
    return "\n".join([first, f"| {' | '.join(rule)} |", *others])
