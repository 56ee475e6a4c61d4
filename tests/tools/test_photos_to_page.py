"""`desplat`: what is missing is made, what is there stays."""

import json
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.core.console import says_what_is_next
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.tools import photos_to_page
from desplat_ns.tools.commands.desplat import PhotosToPage
from desplat_ns.training import preview
from lab.synthetic import write_scene
from tests.helpers.registered import EIGHT_VIEWS

STEPS, STOPPED_AT = 24, 12


@pytest.fixture
def short(monkeypatch, tyro_may_build) -> None:
    """Training has `STEPS` steps, and a preview after each third."""
    parse = photos_to_page.parse

    def parse_short(method: str, options: list[str]) -> Any:
        return parse(method, [*options, "--max-num-iterations", str(STEPS)])

    monkeypatch.setattr(photos_to_page, "parse", parse_short)
    monkeypatch.setattr(preview, "EVERY", 0.0)
    monkeypatch.setattr(preview, "COST", 1e9)


@pytest.mark.slow
def test_it_goes_on_where_it_was_stopped_and_then_makes_nothing_anew(
    short, tmp_path: Path, monkeypatch, capsys
):
    write_scene(EIGHT_VIEWS, tmp_path / "photos")
    output, after_step = tmp_path / "out", preview.Preview.after_step

    def stop(self: Any, step: int, **how: Any) -> None:
        after_step(self, step, **how)
        if step == STOPPED_AT:
            self.trainer._stop_after_this_step("Ctrl+C")

    monkeypatch.setattr(preview.Preview, "after_step", stop)
    make = PhotosToPage(tmp_path / "photos", output).main
    with pytest.raises(SystemExit) as ended:
        make()
    assert ended.value.code == 130 and not (output / "report.html").exists()
    page = (output / "preview.html").read_text()
    assert f"Step {STOPPED_AT + 1} of {STEPS}" in page and page.count("<img") >= 2

    make()
    lines = capsys.readouterr().out
    assert f"Going on from {output}" in lines and "report.html" in lines
    assert "Part 2 of 6, training: " in lines and "Next: " not in lines and not says_what_is_next()
    made = [output / name for name in ("report.html", "scene.html", "scene.ply", "masks")]
    times = [path.stat().st_mtime_ns for path in made]
    assert json.loads((output / photos_to_page.RECORD).read_text())["trained"] == {"desplat": None}

    make()
    assert [path.stat().st_mtime_ns for path in made] == times

    PhotosToPage(output / "training/out/desplat/run/config.yml", tmp_path / "again").main()
    assert all((tmp_path / "again" / path.name).exists() for path in made)
    with pytest.raises(ConfigError, match="budget"):
        PhotosToPage(tmp_path / "photos", tmp_path / "short", budget="20s").main()


def test_nothing_is_mixed_with_other_files(tmp_path: Path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/letter.txt").write_text("")
    with pytest.raises(ConfigError, match="letter"):
        PhotosToPage(tmp_path / "photos", tmp_path / "out").main()
    record = tmp_path / "out2" / photos_to_page.RECORD
    record.parent.mkdir()
    record.write_text(json.dumps({"photos": "/elsewhere"}))
    with pytest.raises(ConfigError, match="elsewhere"):
        PhotosToPage(tmp_path / "photos", record.parent).main()
    with pytest.raises(ConfigError, match="among the photos"):
        PhotosToPage(tmp_path / "photos", tmp_path / "photos/out").main()
    with pytest.raises(CaptureError, match="nowhere"):
        PhotosToPage(tmp_path / "nowhere").main()
