"""A capture that is made from plain features, made once more from thorough ones.

pycolmap's part is made up here; everything else is what a call does.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from desplat_ns.commands.process import run
from desplat_ns.errors import DeSplatError
from desplat_ns.process import process
from desplat_ns.process.attempts import Attempt, Task
from desplat_ns.process.recipes import PLAIN, THOROUGH
from desplat_ns.process.request import Request

OBSERVATIONS = {"plain": 100, "thorough": 200}


@pytest.fixture
def made(photo_writer, tmp_path: Path, monkeypatch) -> Callable[..., Request]:
    """`made()`: three photos, made plainly; `posed` says how many photos each way poses then."""
    posed = {"plain": 3, "thorough": 3}

    def attempt(task: Task) -> Attempt:
        recipe = THOROUGH if task.request.effort == "thorough" else PLAIN
        task.folder.stage(f"mapping ({recipe.name})", list)
        copies = [photo.copy for photo in task.photos][: posed[recipe.name]]
        model = {"photos": copies, "points": 9, "error": 0.5, "folder": "0"}
        return Attempt(recipe, [{**model, "observations": OBSERVATIONS[recipe.name]}], [])

    def undistort(folder, request, photos, best) -> None:
        (folder.output / "images").mkdir(exist_ok=True)
        (folder.output / "images" / "made").write_text(best.recipe.name)

    monkeypatch.setattr(process, "best_attempt", attempt)
    monkeypatch.setattr(process, "_undistort", undistort)

    def make(keep_work: bool = False, **changed: int) -> Request:
        for seed, name in enumerate("abc"):
            photo_writer(tmp_path / "p" / f"{name}.png", 60, 40, seed=seed)
        request = Request(tmp_path / "p", tmp_path / "out", threads=1, keep_work=keep_work)
        run(request)
        posed.update(changed)
        return Request(tmp_path / "p", tmp_path / "out", threads=1, effort="thorough")

    return make


def recorded(request: Request) -> dict:
    return json.loads((request.output / "process.json").read_text("utf8"))["stages"]


@pytest.mark.parametrize("keep_work", [False, True])
def test_a_better_one_takes_the_place_of_the_first(made, capsys, keep_work: bool):
    thorough = made(keep_work)
    capsys.readouterr()
    run(thorough)
    said = capsys.readouterr().out
    assert "Once more, thoroughly" in said and "(thorough features)" in said
    assert (thorough.output / "images" / "made").read_text() == "thorough"
    assert recorded(thorough)["findings"]["result"]["observations"] == OBSERVATIONS["thorough"]
    assert ("mapping (plain)" in recorded(thorough)) == keep_work, "what is gone is not said done"
    run(thorough)
    said = capsys.readouterr().out
    assert "is made already" in said and "rm -r '" in said and "--effort" not in said


def test_one_with_fewer_photos_does_not(made, capsys):
    thorough = made(thorough=2)
    run(thorough)
    assert "That poses 2 photos, no more" in capsys.readouterr().out
    assert (thorough.output / "images" / "made").read_text() == "plain"
    assert recorded(thorough)["findings"]["result"]["recipe"] == "plain"
    run(thorough)
    said = capsys.readouterr().out
    assert "is made already" in said and "Once more" not in said


def test_the_first_stays_finished_where_the_second_is_interrupted(made, capsys, monkeypatch):
    thorough = made()

    def interrupted(task: Task) -> Attempt:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(process, "best_attempt", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(thorough)
    plain = Request(thorough.photos, thorough.output, threads=1, keep_work=True)
    run(plain)
    said = capsys.readouterr().out
    assert "is made already" in said and "the same with --effort thorough" in said
    run(thorough)
    assert (thorough.output / "images" / "made").read_text() == "thorough"


def test_what_an_interrupted_try_left_in_the_record_is_not_taken_for_done(made):
    """As of a video whose frames were taken out, and then the work folder removed."""
    thorough = made()
    path = thorough.output / "process.json"
    record = json.loads(path.read_text("utf8"))
    record["stages"]["frames"] = {"result": ["frame.png"], "seconds": 1.0}
    del record["stages"]["photos"]
    path.write_text(json.dumps(record), "utf8")
    run(thorough)
    assert "frames" not in recorded(thorough)
    assert (thorough.output / "images" / "made").read_text() == "thorough"


def test_a_capture_that_is_made_stays_where_no_photo_can_be_used_any_more(made):
    thorough = made()
    path = thorough.output / "process.json"
    record = json.loads(path.read_text("utf8"))
    for photo in record["stages"]["photos"]["result"]:
        photo["problem"] = "gone"
    path.write_text(json.dumps(record), "utf8")
    with pytest.raises(DeSplatError, match="0 of 3 photos can be used"):
        run(thorough)
    assert (thorough.output / "images" / "made").read_text() == "plain"
    assert "findings" in recorded(thorough)
