"""The time that is left is told by what is done, in lines where no bar can be drawn."""

import os
import pty
import re
import sys
from contextlib import suppress
from types import SimpleNamespace

import pytest

from desplat_ns.core import console
from desplat_ns.core.console import progress_over, progress_with_time_left, seconds_left


def test_the_time_left_follows_the_pace_and_not_a_slow_start_or_what_was_done_before():
    assert seconds_left([(0.0, 0)], 10) is None
    assert seconds_left([(0.0, 0), (2.0, 1)], 10) == 18.0
    slow_start = [(0.0, 0), (30.0, 1), (31.0, 2), (32.0, 3)]
    assert seconds_left(slow_start, 10) == 7.0
    assert seconds_left([(0.0, 90), (2.0, 91)], 100) == 18.0


@pytest.fixture
def lines(monkeypatch):
    """What is announced, while `pass_ten_seconds` moves the clock."""
    said, now = list[str](), [0.0]
    monkeypatch.setattr(console, "announce", said.append)
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: now[0]))
    return said, lambda: now.__setitem__(0, now[0] + 10)


def test_where_no_bar_can_be_drawn_a_line_a_minute_tells_the_time(lines):
    said, pass_ten_seconds = lines
    with progress_over(20, "Rendering...") as advance:
        for _ in range(20):
            pass_ten_seconds()
            advance()
    assert said == [
        "Rendering, 1 of 20, about 3 min left.",
        "Rendering, 7 of 20, about 2 min left.",
        "Rendering, 13 of 20, about 1 min 10 s left.",
        "Rendering, 19 of 20, about 10 s left.",
    ]


def test_of_parts_that_differ_no_time_is_told(lines):
    said, pass_ten_seconds = lines
    with progress_with_time_left("Mapping", alike=False) as show:
        for done in range(20):
            pass_ten_seconds()
            show(done, 20)
    assert not said


SHOWS_A_BAR = """
import time
from desplat_ns.core import console

with console.telling({"poses": 60, "training": 240}) as (shown, _):
    shown.begin("poses", "where was each photo taken?")
    with console.progress_over(2, "Matching") as advance:
        advance()
        time.sleep(0.6)
    shown.begin("training", "the scene.")
    shown.tell("Step 10 of 20", None, 120, is_whole=True)
    time.sleep(0.6)
"""


def test_one_bar_in_a_narrow_terminal_tells_of_all_parts():
    lines = in_terminal(SHOWS_A_BAR, columns=40)
    bars = [line for line in lines if "━" in line]
    assert bars and max(map(len, bars)) < 40
    assert any(line.endswith("About 1 min; about 5 min with all that follows.") for line in lines)
    assert any(
        line.startswith("Part 2 of 2") and line.endswith("about 2 min left") for line in bars
    )


def in_terminal(program: str, columns: int) -> list[str]:
    """What a Python program writes to a terminal of so many columns; a line that is rewritten
    counts each time."""
    pid, handle = pty.fork()
    if pid == 0:
        os.environ |= {"TERM": "xterm", "COLUMNS": str(columns), "PYTHONPATH": os.getcwd()}
        os.execv(sys.executable, [sys.executable, "-c", program])
    written = b""
    with suppress(OSError):  # Linux's way to say that the terminal is closed
        while some := os.read(handle, 65536):
            written += some
    assert os.waitpid(pid, 0)[1] == 0, written.decode()
    escape = re.compile(r"\x1b\[[0-9;?]*([A-Za-z])")
    plain = escape.sub(lambda found: "\n" if found[1] == "K" else "", written.decode())
    return [line.strip() for line in re.split(r"[\r\n]+", plain) if line.strip()]
