"""The package's own commands, one file each: options and printing only. `parser_words` reads the
name and the options of a data parser behind a command's own.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from desplat_ns.errors import print_user_errors_plainly
from desplat_ns.runs.files import RunFiles, find_run
from desplat_ns.settings.options import check_ranges


@dataclass
class OfRun:
    """The options of a command that takes a trained run; its own have names, too."""

    load_config: Path
    """config.yml of the run."""
    data: Path | None = None
    """Folder of the capture, if it is not where it was trained on."""

    def find(self) -> RunFiles:
        """The run's files, once the options are in their ranges. Raises DeSplatError."""
        check_ranges(self)
        return find_run(self.load_config, self.data)


def run(command: Any, **options: Any) -> None:
    """Read a command's options, call its `main`, and print a user's mistake without a traceback.

    Args:
        command: a dataclass with `main`, or a union of such.
        options: of `tyro.cli`.
    """
    print_user_errors_plainly()
    tyro.cli(command, prog=Path(sys.argv[0]).name, **options).main()
