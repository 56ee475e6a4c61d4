"""The parts of the package from the lowest layer up, and a picture of what imports what.

    python -m lab.package_map

writes docs/dev/package_map.svg. A part is a sub-package or a single module directly under
`desplat_ns/`; a test holds the order below against the code's own imports.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from functools import cache
from html import escape
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
PACKAGE = CHECKOUT / "desplat_ns"
PICTURE = CHECKOUT / "docs" / "dev" / "package_map.svg"

LAYERS: tuple[tuple[str, ...], ...] = (
    ("cores", "errors"),
    ("backend", "settings", "console", "", "files"),
    ("rendering", "", "data"),
    ("gaussians", "process", "survey", "fetch"),
    ("training",),
    ("", "photo_tourism"),
    ("separation", "viewer", "nerfstudio_quirks", "lit_model", "layouts"),
    ("", "static_model", "", "datamanager"),
    ("model",),
    ("evaluation", "calibration"),
    ("", "pipeline"),
    ("", "run_config"),
    ("trainer", "", "runs"),
    ("method_configs",),
    ("", "export", "studies"),
    ("", "scene", "reproduce"),
    ("report",),
    ("", "", "", "commands"),
)
"""Parts from the lowest layer up, in columns; "" for an empty place. A part imports parts of lower
layers only."""

BOX, GAP, ROW, MARGIN = (150, 34), 30, 70, 20
"""Pixels: a part's width and height, between two of them, from layer to layer, around all."""

PACKAGE_FILL, MODULE_FILL, LINE = "#d9e8f5", "#f3e9d2", "#8a97a5"


def part_of(module: str) -> str:
    """The part in which a module (`desplat_ns.data.colmap`) is; empty for the package itself."""
    return [*module.split("."), ""][1]


def module_of(path: Path) -> str:
    """The dotted name of a file of the package."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_modules(path: Path) -> Iterator[str]:
    """Modules of the package that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text("utf8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == PACKAGE.name:
            module = str(node.module)
            folder = PACKAGE.parent.joinpath(*module.split("."))
            for name in node.names:  # of a package, a name may be a module
                inside = (folder / f"{name.name}.py").is_file() or (folder / name.name).is_dir()
                yield f"{module}.{name.name}" if inside else module
        elif isinstance(node, ast.Import):
            yield from (n.name for n in node.names if n.name.split(".")[0] == PACKAGE.name)


@cache
def module_imports() -> dict[str, set[str]]:
    """For each module of the package those of it that it imports. Read once in a process."""
    return {
        module_of(path): set(imported_modules(path)) - {module_of(path)}
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def part_imports() -> dict[str, set[str]]:
    """For each part the parts that it imports."""
    parts: dict[str, set[str]] = {}
    for module, imported in module_imports().items():
        part = part_of(module)
        parts.setdefault(part, set()).update(part_of(name) for name in imported)
    parts.pop("", None)
    return {part: imported - {part, ""} for part, imported in parts.items()}


def may_import(part: str) -> set[str]:
    """The parts that a package's docstring says it may import."""
    text = ast.get_docstring(ast.parse((PACKAGE / part / "__init__.py").read_text("utf8"))) or ""
    _, _, names = text.partition("May import ")
    return set(re.findall(r"`(\w+)`", names.split(".")[0]))


def layers() -> dict[str, int]:
    """The layer of every part, from 0."""
    return {part: layer for layer, parts in enumerate(LAYERS) for part in parts if part}


def direct(imports: Mapping[str, set[str]]) -> Iterator[tuple[str, str]]:
    """The arrows of a picture: imports that do not follow from two others in a row."""

    def reach(part: str) -> set[str]:
        return imports[part].union(*(reach(other) for other in imports[part]))

    for part, imported in sorted(imports.items()):
        by_others = set().union(*(reach(other) for other in imported))
        yield from ((part, other) for other in sorted(imported - by_others))


def places() -> dict[str, tuple[float, float]]:
    """Left upper corners of the parts; the lowest layer is at the bottom."""
    return {
        part: (MARGIN + column * (BOX[0] + GAP), MARGIN + (len(LAYERS) - 1 - layer) * ROW)
        for layer, parts in enumerate(LAYERS)
        for column, part in enumerate(parts)
        if part
    }


def picture() -> str:
    """The parts and their direct imports, as SVG."""
    at = places()
    width = 2 * MARGIN + max(map(len, LAYERS)) * (BOX[0] + GAP) - GAP
    height = 2 * MARGIN + (len(LAYERS) - 1) * ROW + BOX[1]
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for part, imported in direct(part_imports()):
        x, y, to_x, to_y = *at[part], *at[imported]
        start, end = (x + BOX[0] / 2, y + BOX[1]), (to_x + BOX[0] / 2, to_y)
        bend = (end[1] - start[1]) / 2
        lines.append(
            f'<path d="M{start[0]:g} {start[1]:g} C{start[0]:g} {start[1] + bend:g} '
            f'{end[0]:g} {end[1] - bend:g} {end[0]:g} {end[1]:g}" fill="none" stroke="{LINE}"/>'
        )
    for part, (x, y) in at.items():
        fill = PACKAGE_FILL if (PACKAGE / part).is_dir() else MODULE_FILL
        lines += [
            f'<rect x="{x:g}" y="{y:g}" width="{BOX[0]}" height="{BOX[1]}" rx="6" fill="{fill}" '
            f'stroke="{LINE}"/>',
            f'<text x="{x + BOX[0] / 2:g}" y="{y + BOX[1] / 2 + 5:g}" text-anchor="middle">'
            f"{escape(part)}</text>",
        ]
    return "\n".join([*lines, "</svg>", ""])


def main() -> None:
    """Write the picture."""
    PICTURE.write_text(picture(), "utf8")
    print(f"Wrote {PICTURE.relative_to(CHECKOUT)}.")


if __name__ == "__main__":
    main()
