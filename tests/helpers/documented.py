"""Commands and Python in the documents, and the parsers that take them."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import tyro

PROGRAM = re.compile(r"(?:ns|desplat)-[a-z-]+$|make$|(?:.*/)?python[\d.]*$|(?:.*/)?pip$|uv$")

SCRIPTS = {
    "desplat-eval": "desplat_ns.commands.evaluate:Evaluate",
    "desplat-export": "desplat_ns.commands.export:Command",
    "desplat-fetch-data": "desplat_ns.commands.fetch_data:Arguments",
    "desplat-process": "desplat_ns.process.request:Request",
    "desplat-report": "desplat_ns.commands.report:Report",
    "desplat-reproduce": "desplat_ns.commands.reproduce:Arguments",
    "ns-eval": "nerfstudio.scripts.eval:ComputePSNR",
    "ns-export": "nerfstudio.scripts.exporter:Commands",
    "ns-render": "nerfstudio.scripts.render:Commands",
    "ns-viewer": "nerfstudio.scripts.viewer.run_viewer:RunViewer",
    "ns-train": "nerfstudio.configs.method_configs:AnnotatedBaseConfigUnion",
}
"""What tyro reads the words of each program into."""

WITH_PARSER = {
    "desplat-survey": "desplat_ns.commands.survey:Arguments",
    "desplat-tradeoff": "desplat_ns.commands.tradeoff:Arguments",
}
"""The same of those behind whose own options a data parser may stand."""


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


def parse(command: Documented, checkout: Path) -> Any:
    """Read a command's words as its program does.

    Raises:
        AssertionError: the program does not take them.
    """
    program, words = command.program, list(command.words[1:])
    if program in SCRIPTS:
        return _read(lambda: tyro.cli(_named(SCRIPTS[program]), args=words), command)
    if program in WITH_PARSER:
        from desplat_ns.commands.parser_words import parse as parse_with_data

        arguments = _named(WITH_PARSER[program])
        return _read(lambda: parse_with_data(arguments, program, words), command)
    if program == "make":
        targets = [word for word in words if "=" not in word]
        makefile = (checkout / "Makefile").read_text("utf8")
        assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets), command
    elif program.startswith("python") and words[0] == "-m" and words[1] not in ("pip", "venv"):
        import_module(words[1])
    return None


def _named(where: str) -> Any:
    module, _, name = where.partition(":")
    return getattr(import_module(module), name)


def _read(reading: Callable[[], Any], command: Documented) -> Any:
    """What a parser makes of a command; it leaves by SystemExit where it takes it not."""
    try:
        return reading()
    except SystemExit as left:
        sys.stdout.flush()
        raise AssertionError(f"{command} is not taken") from left
