"""A command in a process of its own that must not import what takes seconds."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

SCRIPT = """
import sys
from importlib import import_module
name, *sys.argv = sys.argv[1:]
try:
    import_module(f"desplat_ns.commands.{name}").main()
finally:
    assert not {"torch", "nerfstudio.engine.trainer"} & set(sys.modules), "a heavy import"
"""


def check_quick_command(
    name: str, arguments: Sequence[str], status: int, words: str, checkout: Path
) -> None:
    """Make sure that a command of `desplat_ns.commands` says `words`, ends with `status`, and
    imports nothing heavy on the way."""
    line = [sys.executable, "-c", SCRIPT, name, f"desplat-{name}", *arguments]
    done = subprocess.run(line, cwd=checkout, capture_output=True, text=True)
    assert words in done.stdout + done.stderr
    assert "heavy" not in done.stderr
    assert done.returncode == status
