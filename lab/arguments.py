"""What the command lines of the laboratory have in common; standard library only."""

from __future__ import annotations

import argparse


def parser_of(program: str, description: str | None) -> argparse.ArgumentParser:
    """A parser whose help shows a module's docstring as it stands."""
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(program, description=description, formatter_class=formatter)
