"""Write docs/results/dials.md from docs/records/dials.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from desplat_ns.files.whole import write_whole
from lab.documents import RECORDS, RESULTS
from lab.grid.tables import table
from lab.pixels.dial_points import ANTIALIASING, APPEARANCE, RASTERIZING

FILE = RECORDS / "dials.json"
"""By captures: `dials`, a `DialStudy` of its size, and `embedding`, `Score`s of its runs."""
REPORT = RESULTS / "dials.md"
TEMPLATE = Path(__file__).with_name("dials.md.template")

GROUPS = (RASTERIZING, ANTIALIASING, APPEARANCE)
HEAD = ["dial", "backend", "forward, ms", "and backward, ms", "error of the picture", "PSNR, dB"]
HEAD += ["error of gradients"]
FRONT = " ●"

Captures = dict[str, dict[str, Any]]


def load(path: Path = FILE) -> Captures:
    """What was measured; nothing if there is no file."""
    return json.loads(path.read_text("utf8")) if path.exists() else {}


def enter(name: str, what: str, measured: Any, path: Path = FILE) -> None:
    """Enter what was measured of a capture; an earlier one is replaced."""
    content = load(path)
    content.setdefault(name, {})[what] = measured
    write_whole(path, (json.dumps(content, indent=1) + "\n").encode())


def dial_table(points: Sequence[Mapping[str, Any]], group: str) -> str:
    """A row for each point of a group, today's default first; what is on the front is marked."""
    chosen = [case for case in points if case["group"] == group]
    rows = []
    for case in sorted(chosen, key=lambda case: not case["is_default"]):
        dial = "**today's default**" if case["is_default"] else f"{case['dial']}: {case['value']}"
        forward = f"{case['forward_ms']:.3g}" + FRONT * case["is_on_picture_front"]
        both = f"{case['both_ms']:.3g}" + FRONT * case["is_on_gradient_front"]
        errors = [f"{case[key]:.3g}" for key in ("picture_error", "picture_psnr", "gradient_error")]
        rows.append([dial, case["backend"], forward, both, *errors])
    return table(HEAD, rows)


def embedding_table(captures: Captures) -> str:
    """A row for each score of each capture."""
    rows = [
        [
            f"`{name}`",
            score["setting"],
            "-" if score["steps"] is None else str(score["steps"]),
            f"{score['psnr']:.2f}",
            f"{score['seconds_per_image']:.3g}",
        ]
        for name, content in sorted(captures.items())
        for score in content.get("embedding", ())
    ]
    return table(["capture", "setting", "steps", "PSNR, dB", "s a photo"], rows)


def report(captures: Captures) -> str:
    """The document's text."""
    parts = []
    for name, content in sorted(captures.items()):
        if "dials" in content:
            parts.append(f"## Gaussians of `{name}`'s size: {content['dials']['scene']}")
            points = content["dials"]["points"]
            kept = [group for group in GROUPS if any(point["group"] == group for point in points)]
            for group in kept:
                parts += [f"### {group[0].upper()}{group[1:]}", dial_table(points, group)]
    text = TEMPLATE.read_text("utf8")
    return Template(text).substitute(dials="\n\n".join(parts), embedding=embedding_table(captures))


def write_report() -> Path:
    """Write the document; where it is."""
    REPORT.write_text(report(load()), "utf8")
    return REPORT
