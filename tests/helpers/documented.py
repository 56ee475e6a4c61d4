"""Commands and Python in the documents, and the programs that take them."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import tyro

PROGRAM = re.compile(r"(?:ns|desplat)-[a-z-]+$|make$|(?:.*/)?python[\d.]*$|(?:.*/)?pip$|uv$")


@dataclass(frozen=True)
class Documented:
    """A command on a page."""

    page: str
    line: int
    words: tuple[str, ...]
    """Without what is set before it (`VARIABLE=value`), and without its comment."""

    @property
    def program(self) -> str:
        return self.words[0].rsplit("/", 1)[-1]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {' '.join(self.words)}"


def pages(checkout: Path) -> list[Path]:
    """README, CONTRIBUTING and everything in docs/."""
    return [
        checkout / "README.md",
        checkout / "CONTRIBUTING.md",
        *sorted((checkout / "docs").rglob("*.md")),
    ]


def commands(page: Path, text: str) -> Iterator[Documented]:
    """The commands in the indented and fenced blocks of a page."""
    lines, fenced, number = text.splitlines(), False, 0
    while number < len(lines):
        line, start = lines[number], number + 1
        number += 1
        if line.startswith("```"):
            fenced = not fenced
            continue
        if not fenced and not line.startswith("    "):
            continue
        while line.endswith("\\") and number < len(lines):
            line = line[:-1] + lines[number]
            number += 1
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # an apostrophe: no command
            continue
        while words and re.match(r"[A-Z_]+=", words[0]):
            words = words[1:]
        for cut in (">", "|", "&&"):
            words = words[: words.index(cut)] if cut in words else words
        if words and PROGRAM.match(words[0]):
            yield Documented(page.name, start, tuple(words))


def python_blocks(text: str) -> list[str]:
    """The blocks of a page that are Python."""
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


class _Parsed(Exception):
    """What tyro made of a program's words, in place of what the program does with it."""


def parse(command: Documented, checkout: Path) -> Any:
    """Read a command's words as its program does.

    Raises:
        AssertionError: the program does not take them.
    """
    program, words = command.program, list(command.words[1:])
    scripts = {script.name: script for script in entry_points(group="console_scripts")}
    if program.startswith(("ns-", "desplat-")):
        return _read(scripts[program].load(), command)
    if program == "make":
        targets = [word for word in words if "=" not in word]
        makefile = (checkout / "Makefile").read_text("utf8")
        assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets), command
    elif program.startswith("python") and words[0] == "-m" and words[1] not in ("pip", "venv"):
        import_module(words[1])
    return None


def _read(program: Callable[[], None], command: Documented) -> Any:
    """What tyro makes of a command; it leaves by SystemExit where it takes it not."""
    read = tyro.cli

    def stop(*arguments: Any, **options: Any) -> Any:
        raise _Parsed(read(*arguments, **options))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", list(command.words))
        patch.setattr(sys, "excepthook", sys.excepthook)
        patch.setattr(tyro, "cli", stop)
        try:
            program()
        except _Parsed as parsed:
            (result,) = parsed.args
            if isinstance(result, tuple):  # what follows are a data parser's name and options
                result, rest = result
                assert not rest or not rest[0].startswith("-"), f"{command} is not taken: {rest}"
            return result
        except SystemExit as left:
            sys.stdout.flush()
            raise AssertionError(f"{command} is not taken") from left
