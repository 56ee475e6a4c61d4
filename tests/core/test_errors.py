"""What ends a command is told in a sentence, not in a traceback; what is said on the console."""

import sys

import pytest
from nerfstudio.utils.rich_utils import CONSOLE

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError, begin_run


@pytest.fixture
def hook(monkeypatch):
    others: list[BaseException] = []
    monkeypatch.setattr(sys, "excepthook", lambda kind, error, trace: others.append(error))
    begin_run()
    return lambda error: (sys.excepthook(type(error), error, None), others)[1]


def test_a_users_mistake_is_told_plainly_and_any_other_error_goes_where_it_went(hook, capsys):
    assert hook(CaptureError("no photos in 'x'")) == []
    assert capsys.readouterr().err.strip() == "Error: no photos in 'x'"
    assert hook(KeyboardInterrupt()) == []
    assert "Ctrl+C" in capsys.readouterr().err
    error = ValueError("ours")
    assert hook(error) == [error]
    assert capsys.readouterr().err == ""


def test_names_forge_no_lines_and_no_colours_and_keep_their_brackets(hook, capsys):
    name = "grün\x1b[2J\nError: all is well\r\udcfc\u202e"
    hook(CaptureError(name))
    announce(name)
    shown = capsys.readouterr()
    escaped = r"grün\x1b[2J\nError: all is well\r\udcfc\u202e"
    assert shown.err == f"\nError: {escaped}\n" and shown.out == f"{escaped}\n"
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
