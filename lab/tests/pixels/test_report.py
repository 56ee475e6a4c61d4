"""The page of what exactness costs is that of its records."""

from __future__ import annotations

from pathlib import Path

from lab.pixels.report import REPORT, enter, load, report


def test_the_page_is_that_of_the_records():
    """Made anew by `python -m lab.pixels`."""
    assert REPORT.read_text("utf8") == report(load())


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
