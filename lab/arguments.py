"""What the command lines of the laboratory have in common; standard library only."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lab.documents import CHECKOUT


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """A parser whose help shows a module's docstring as it stands."""
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(program, description=description, formatter_class=formatter)


def parse_measurement(
    parser: argparse.ArgumentParser, output: Path, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """Options of a measurement that can be tried out with `--quick`, which then needs a folder.

    Args:
        output: folder of what is kept, unless `--output` names another.
    """
    parser.add_argument("--quick", action="store_true", help="little of everything: a check only")
    place = f"folder ({output.relative_to(CHECKOUT)}; needed if quick)"
    parser.add_argument("--output", type=Path, help=place)
    chosen = parser.parse_args(arguments)
    if chosen.quick and chosen.output is None:
        parser.error("--quick measures nothing to keep: name a folder with --output")
    chosen.output = chosen.output or output
    return chosen
