"""Write docs/reference/options.md from the configuration classes: what every option is for.

python -m lab.options
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

from desplat_ns import method_configs
from desplat_ns.data.on_the_go import on_the_go_dataparser
from desplat_ns.data.robustnerf import robustnerf_dataparser
from desplat_ns.layouts.dataparser import desplat_dataparser
from desplat_ns.photo_tourism.dataparser import photo_tourism_dataparser
from desplat_ns.studies.records import markdown_table
from lab import DOCS

REPORT = DOCS / "reference" / "options.md"
TEMPLATE = Path(__file__).with_name("options.md.template")

OURS = "desplat_ns"
"""The package; what nerfstudio's classes bring is not listed."""

UNUSED = "Not used: the capture decides."
"""What data parsers say of nerfstudio's options that mean nothing to them."""

METHODS = (
    method_configs.desplat,
    method_configs.desplat_quick,
    method_configs.desplat_phototourism,
    method_configs.desplat_paper,
    method_configs.desplat_phototourism_paper,
    method_configs.desplat_phototourism_a_paper,
)

DATAPARSERS = {
    "desplat-data": desplat_dataparser,
    "robustnerf-data": robustnerf_dataparser,
    "on-the-go-data": on_the_go_dataparser,
    "photo-tourism-data": photo_tourism_dataparser,
}

COMMANDS = {
    "desplat-process": "process.request:Request",
    "desplat-survey": "commands.survey:Arguments",
    "desplat-eval": "commands.evaluate:Evaluate",
    "desplat-report": "commands.report:Report",
    "desplat-export splats": "commands.export:Splats",
    "desplat-export page": "commands.export:Page",
    "desplat-export masks": "commands.export:Masks",
    "desplat-tradeoff": "commands.tradeoff:Arguments",
    "desplat-fetch-data": "commands.fetch_data:Arguments",
    "desplat-reproduce": "commands.reproduce:Arguments",
}
"""Where the options of each command are."""


HEADS = ("option", "`desplat`", "`desplat-paper`, if another", "meaning")

PARTS = (
    "--",
    "--pipeline.model.effects.",
    "--pipeline.model.distractors.",
    "--pipeline.model.appearance.",
    "--pipeline.model.background.",
    "--pipeline.model.",
    "--pipeline.datamanager.",
    "--pipeline.evaluation.",
)
"""A table each."""


@dataclass(frozen=True)
class Option:
    """One row of a table."""

    name: str
    """As it is typed, with its dots."""
    default: Any
    meaning: str


def meanings(owner: type) -> dict[str, str]:
    """What the docstrings below the fields of a dataclass say, those of its ancestors included."""
    texts: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        if not is_dataclass(base) or base.__module__.split(".")[0] != OURS:
            continue
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(tree, ast.ClassDef)
        for field, text in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                name, value = field.target, text.value
                if isinstance(name, ast.Name) and isinstance(value, ast.Constant):
                    texts[name.id] = " ".join(str(value.value).split())
    return texts


def options(config: Any, prefix: str = "--") -> Iterator[Option]:
    """The options of a configuration and of all that it holds, as far as the package adds them.

    Args:
        config: a dataclass of `ns-train`'s, or a part of it.
    """
    docs = meanings(type(config))
    for field in fields(config):
        value = getattr(config, field.name)
        name = f"{prefix}{field.name.replace('_', '-')}"
        if is_dataclass(value) and field.name != "dataparser" and _holds_ours(value):
            yield from options(value, f"{name}.")
        elif field.name in docs and field.name != "dataparser" and docs[field.name] != UNUSED:
            yield Option(name, value, docs[field.name])


def _holds_ours(config: Any) -> bool:
    """Whether any class of a configuration is the package's."""
    return any(base.__module__.split(".")[0] == OURS for base in type(config).__mro__)


def arguments(owner: type) -> Iterator[Option]:
    """The arguments of a command."""
    docs = meanings(owner)
    for field in fields(owner):
        name = field.name.replace("_", "-")
        if is_dataclass(field.default_factory):
            continue
        positional = "Positional" in str(field.type)
        default = _default(field)
        yield Option(name.upper() if positional else f"--{name}", default, docs.get(field.name, ""))


def _default(field: Field[Any]) -> Any:
    if field.default is not MISSING:
        return field.default
    return "needed" if field.default_factory is MISSING else field.default_factory()


def in_words(value: Any) -> str:
    """A default as it is typed."""
    if isinstance(value, Enum):
        value = value.name
    if isinstance(value, (tuple, list)):
        return " ".join(map(str, value))
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e6:
        return f"{value:g}"
    return "" if value is None or value == "" else str(value)


def table(rows: list[Option], others: Mapping[str, Any] | None = None) -> str:
    """Options as Markdown.

    Args:
        others: defaults of a second method, by the names of options; a column of those that differ.
    """
    lines = []
    for option in rows:
        cells = [f"`{option.name}`", in_words(option.default)]
        if others is not None:
            other = others.get(option.name, option.default)
            cells.append("" if other == option.default else in_words(other))
        lines.append([*cells, option.meaning])
    head = ("option", "default", "meaning") if others is None else HEADS
    return markdown_table(head, lines, "l" * len(head))


def methods_table() -> str:
    """The registered methods in their own words."""
    rows = [(f"`{method.config.method_name}`", method.description) for method in METHODS]
    return markdown_table(("method", "what it is"), rows, "ll")


def training_table(part: str) -> str:
    """The options of `ns-train` whose names begin so, and those of the run itself for `--`."""
    paper = {option.name: option.default for option in options(method_configs.desplat_paper.config)}
    ours = options(method_configs.desplat.config)
    return table([option for option in ours if _part_of(option.name) == part], paper)


def _part_of(name: str) -> str:
    """The table in which an option stands."""
    return max((part for part in PARTS if name.startswith(part)), key=len)


def dataparser_table(name: str) -> str:
    """The options of a data parser."""
    return table(list(options(DATAPARSERS[name].config)))


def command_table(name: str) -> str:
    """The options of a command."""
    module, _, owner = COMMANDS[name].partition(":")
    return table(list(arguments(getattr(import_module(f"{OURS}.{module}"), owner))))


def page() -> str:
    """The whole page, from its template."""
    kinds = {
        "methods": lambda _: methods_table(),
        "training": training_table,
        "dataparser": dataparser_table,
        "command": command_table,
    }

    def filled(match: re.Match[str]) -> str:
        kind, _, rest = match[1].partition(" ")
        return kinds[kind](rest)

    return re.sub(r"\{\{(.*?)\}\}", filled, TEMPLATE.read_text("utf8"))


if __name__ == "__main__":
    REPORT.write_text(page(), "utf8")
    print(REPORT)
