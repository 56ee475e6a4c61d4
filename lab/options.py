"""Write docs/reference/options.md from the configuration classes: what every option is for.

python -m lab.options
"""

import ast
import inspect
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from importlib import import_module
from typing import Any

from desplat_ns import method_configs
from desplat_ns.data.layouts import desplat_dataparser
from desplat_ns.data.on_the_go import on_the_go_dataparser
from desplat_ns.data.photo_tourism import photo_tourism_dataparser
from desplat_ns.data.robustnerf import robustnerf_dataparser
from lab import DOCS, markdown_table

REPORT = DOCS / "reference" / "options.md"

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

PARTS = {
    "--": "The run",
    "--pipeline.model.effects.": "Effects\n\nSwitches; `auto` lets the survey decide what is not "
    "given ([survey.md](../explain/survey.md)).",
    "--pipeline.model.": "Static scene and backend",
    "--pipeline.model.distractors.": "Distractors",
    "--pipeline.model.appearance.": "Appearance",
    "--pipeline.datamanager.": "Photos in memory",
    "--pipeline.evaluation.": "Evaluation\n\nSaved with the run; `desplat-eval` can change them "
    "later.",
}
"""How names of `ns-train`'s options begin, and the heading of their table."""

DATAPARSERS = {
    "desplat-data\n\nThe default: it recognises the layout and hands over to one of the others "
    "([data.md](data.md)).": desplat_dataparser,
    "robustnerf-data": robustnerf_dataparser,
    "on-the-go-data": on_the_go_dataparser,
    "photo-tourism-data": photo_tourism_dataparser,
}

COMMANDS = {
    "desplat": "commands.desplat:PhotosToPage",
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
"""Where the options of each command are, in `tools`."""

HEAD = """---
orphan: true
---

# Options

Written by `python -m lab.options` from the configuration classes; to change a word, change the \
docstring there. Listed is what this package adds or changes.
Splatfacto's and nerfstudio's own options stay as they are: `ns-train desplat --help` lists all. \
An empty default means that the option is not given."""

TRAINING = """## Training

`ns-train METHOD --data CAPTURE` takes these options before the name of a data parser."""

PARSING = """## Data parsers

Their options follow the parser's name at the end of the command: `ns-train desplat --data capture \
desplat-data --downscale-factor 2`."""

CALLING = """## Commands

Words in capitals are given without a name, in this order. `--help` after any command says the \
same. Switches that are on by default are turned off by `--no-NAME`."""


@dataclass(frozen=True)
class Option:
    """One row of a table."""

    name: str
    """As it is typed, with its dots."""
    default: Any
    meaning: str


def is_ours(kind: type) -> bool:
    return kind.__module__.split(".")[0] == OURS


def meanings(owner: type) -> dict[str, str]:
    """What the docstrings below the fields of a dataclass say, those of its ancestors included."""
    texts: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        if not is_dataclass(base) or not is_ours(base):
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
    """The options that the package adds to a configuration of `ns-train`, or to a part of it."""
    docs = meanings(type(config))
    for field in fields(config):
        value = getattr(config, field.name)
        name = f"{prefix}{field.name.replace('_', '-')}"
        if field.name == "dataparser":
            continue
        if is_dataclass(value) and any(map(is_ours, type(value).__mro__)):
            yield from options(value, f"{name}.")
        elif docs.get(field.name, UNUSED) != UNUSED:
            yield Option(name, value, docs[field.name])


def arguments(owner: type) -> Iterator[Option]:
    """The arguments of a command."""
    docs = meanings(owner)
    for field in fields(owner):
        default, make = field.default, field.default_factory
        if default is MISSING and not is_dataclass(make):
            default = "needed" if make is MISSING else make()
        name = field.name.replace("_", "-")
        name = name.upper() if "Positional" in str(field.type) else f"--{name}"
        if not is_dataclass(make):
            yield Option(name, default, docs.get(field.name, ""))


def in_words(value: Any) -> str:
    """A default as it is typed."""
    if isinstance(value, Enum):
        value = value.name
    if isinstance(value, (tuple, list)):
        return " ".join(map(str, value))
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e6:
        return f"{value:g}"
    return "" if value is None else str(value)


def table(rows: list[Option], others: Mapping[str, Any] | None = None) -> str:
    """Options as Markdown.

    Args:
        others: defaults of `desplat-paper` by the names of options: a column of those that differ.
    """
    lines = []
    for option in rows:
        cells = [f"`{option.name}`", in_words(option.default)]
        if others is not None:
            other = others.get(option.name, option.default)
            cells.append("" if other == option.default else in_words(other))
        lines.append([*cells, option.meaning])
    head = ["option", "default", "meaning"]
    if others is not None:
        head = ["option", "`desplat`", "`desplat-paper`, if another", "meaning"]
    return markdown_table(head, lines, "l" * len(head))


def part_of(name: str) -> str:
    """The table in which an option of `ns-train` stands."""
    return max((part for part in PARTS if name.startswith(part)), key=len)


def arguments_of(command: str) -> list[Option]:
    """The arguments of one of `COMMANDS`."""
    module, _, owner = COMMANDS[command].partition(":")
    return [*arguments(getattr(import_module(f"{OURS}.tools.{module}"), owner))]


def page() -> str:
    """The whole page."""
    described = ((each.config.method_name, each.description) for each in METHODS)
    methods = [(f"`{name}`", text.partition("\n")[0]) for name, text in described]
    texts = [HEAD, "## Methods", markdown_table(("method", "what it is"), methods, "ll"), TRAINING]
    paper = {option.name: option.default for option in options(method_configs.desplat_paper.config)}
    ours = [*options(method_configs.desplat.config)]
    for part, heading in PARTS.items():
        rows = [option for option in ours if part_of(option.name) == part]
        texts += [f"### {heading}", table(rows, paper)]
    texts.append(PARSING)
    for heading, parser in DATAPARSERS.items():
        texts += [f"### {heading}", table([*options(parser.config)])]
    texts.append(CALLING)
    for command in COMMANDS:
        texts += [f"### {command}", table(arguments_of(command))]
    return "\n\n".join(texts) + "\n"


if __name__ == "__main__":
    REPORT.write_text(page(), "utf8")
    print(REPORT)
