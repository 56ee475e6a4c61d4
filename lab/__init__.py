"""The laboratory: what the project measures for itself. Only a checkout has it.

Scenes with known truth (`synthetic`), studies whose figures stand in `docs/`, checks of machines
and GPUs. It imports `desplat_ns`, which imports nothing of it.
"""

import argparse
import os
from pathlib import Path

# Before anything loads OpenMP: waiting threads that spin would be counted as work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

CHECKOUT = Path(__file__).resolve().parents[1]
DOCS = CHECKOUT / "docs"
RECORDS = DOCS / "records"
"""What was measured, a line of JSON for each run."""

OUTPUTS = CHECKOUT / "outputs"
"""What studies train, a folder each; git ignores it."""


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """A parser whose help shows a module's docstring as it stands."""
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(program, description=description, formatter_class=formatter)
