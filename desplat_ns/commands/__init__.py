"""The package's own commands, one file each: options and printing only. `parser_words` reads the
name and the options of a data parser behind a command's own.
"""

from __future__ import annotations

from typing import Any

import tyro

from desplat_ns.errors import print_user_errors_plainly


def run(command: Any, **options: Any) -> None:
    """Read a command's options, call its `main`, and print a user's mistake without a traceback.

    Args:
        command: a dataclass with `main`, or a union of such.
        options: of `tyro.cli`.
    """
    print_user_errors_plainly()
    tyro.cli(command, **options).main()
