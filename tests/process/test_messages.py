"""What is said at the end."""

from __future__ import annotations

from pathlib import Path

from desplat_ns.process.process import LISTED, report_lines
from desplat_ns.process.workspace import Workspace


def lines_about(left_out: list[dict[str, str]]) -> list[str]:
    """The report's lines about photos that are left out."""
    findings = {"photos": 3, "of": 9, "points": 5, "error": 0.5, "recipe": "plain", "others": []}
    stages = {"findings": {"seconds": 0.0, "result": {**findings, "left_out": left_out}}}
    return [
        line for line in report_lines(Workspace(Path("out"), {}, {}, stages)) if line[:2] == "  "
    ]


def test_photos_that_are_left_out_for_one_reason_share_a_line():
    missing = [
        {"source": "a.jpg", "reason": "another place"},
        {"source": "b.jpg", "reason": "blurred"},
        {"source": "c.jpg", "reason": "another place"},
    ]
    assert lines_about(missing) == ["  a.jpg, c.jpg: another place", "  b.jpg: blurred"]


def test_of_many_reasons_the_first_are_told_and_the_photos_of_the_others_counted():
    missing = [{"source": f"{i}.jpg", "reason": f"reason {i // 2}"} for i in range(2 * LISTED + 3)]
    lines = lines_about(missing)
    assert len(lines) == LISTED + 1
    assert lines[-1] == "  and 3 more photos, for 2 other reasons"
