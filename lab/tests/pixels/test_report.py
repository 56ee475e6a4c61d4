"""Scores of a capture are entered beside those of others, and have rows in the page."""

from __future__ import annotations

from pathlib import Path

from lab.pixels.report import enter, load, report


def test_what_is_entered_leaves_the_rest(tmp_path: Path):
    file = tmp_path / "dials.json"
    score = {"setting": "affine", "steps": 8, "psnr": 20.0, "seconds_per_image": 0.5}
    enter("fox", "embedding", [], file)
    enter("tree", "embedding", [score], file)
    enter("fox", "embedding", [score | {"steps": None}], file)
    captures = load(file)
    assert list(captures) == ["fox", "tree"]
    page = report(captures)
    assert "| `fox` | affine | - | 20.00 | 0.5 |" in page
    assert "| `tree` | affine | 8 | 20.00 | 0.5 |" in page
