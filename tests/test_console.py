"""What is said on the console."""

from __future__ import annotations

import pytest
from nerfstudio.utils.rich_utils import CONSOLE

from desplat_ns.console import announce


def test_brackets_in_paths_survive_the_console(capsys: pytest.CaptureFixture[str]):
    announce("/a/[bold]/" + "x" * 200)
    assert capsys.readouterr().out == "/a/[bold]/" + "x" * 200 + "\n"


def test_a_console_that_cannot_be_written_to_stops_nothing(monkeypatch: pytest.MonkeyPatch):
    tried = []

    def full(line: str, **_: object) -> None:
        tried.append(line)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CONSOLE, "print", full)
    announce("unheard")
    announce("unheard as well")
    assert tried == ["unheard", "unheard as well"]
