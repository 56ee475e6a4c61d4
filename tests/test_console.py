"""What is said on the console."""

from __future__ import annotations

import pytest
from nerfstudio.utils.rich_utils import CONSOLE
from rich.progress import Progress

from desplat_ns.console import announce, list_names, progress_over


def test_progress_counts_what_is_done(monkeypatch):
    advanced = []
    monkeypatch.setattr(Progress, "advance", lambda self, task: advanced.append(task))
    with progress_over(2, "Testing") as advance:
        advance()
        advance()
    assert len(advanced) == 2


def test_ten_names_are_listed_and_the_rest_is_counted():
    assert list_names(["a", "b"]) == "a, b"
    assert list_names(str(i) for i in range(13)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 3 more"


def test_brackets_in_paths_survive_the_console(capsys: pytest.CaptureFixture[str]):
    announce("/a/[bold]/" + "x" * 200)
    assert capsys.readouterr().out == "/a/[bold]/" + "x" * 200 + "\n"


def test_a_console_that_cannot_be_written_to_stops_nothing(monkeypatch: pytest.MonkeyPatch):
    def full(line: str, **_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CONSOLE, "print", full)
    announce("unheard")
