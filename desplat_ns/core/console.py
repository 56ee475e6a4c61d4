"""What is said on the console: lines, lists of names, progress bars."""

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import cache
from itertools import count
from typing import Any

from nerfstudio.utils.rich_utils import CONSOLE
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from desplat_ns.core.errors import printable

TOLD_FROM, TOLD_EVERY = 5.0, 60.0
"""Seconds after which the time that is left is told first, and from one line to the next."""


def announce(line: str, warning: bool = False) -> None:
    """Print one line on nerfstudio's console; paths stay whole, brackets are kept, and control
    characters shown. Where that fails, as in a log on a full disk, the work goes on."""
    style = "yellow" if warning else None
    with suppress(OSError):
        CONSOLE.print(escape(printable(line)), style=style, soft_wrap=True, highlight=False)


@cache
def announce_once(line: str, warning: bool = False) -> None:
    """As `announce`, once in a process: a capture is read by the survey and by the data manager."""
    announce(line, warning)


def list_names(names: Iterable[str], at_most: int = 10) -> str:
    """`a, b, c and 12 more`: the first names and how many are left."""
    all_names = list(names)
    listed = ", ".join(all_names[:at_most])
    rest = len(all_names) - at_most
    return f"{listed} and {rest} more" if rest > 0 else listed


def text_of(name: str) -> str:
    """A file's name as it can be written: bytes that are no text, as names from old archives have
    them, become `\\xfc`."""
    return os.fsencode(name).decode(errors="backslashreplace")


def time_in_words(seconds: float) -> str:
    """45 s, 2 min 5 s, 1 h 20 min, 2 h."""
    whole = round(seconds)
    units = [("h", whole // 3600), ("min", whole % 3600 // 60)]
    units += [("s", whole % 60)] if whole < 3600 else []
    return " ".join(f"{count} {unit}" for unit, count in units if count) or "0 s"


def about(seconds: float) -> str:
    """An estimate, in words: about 45 s, about 4 min 30 s, about 12 min, about 1 h 20 min."""
    steps = ((120, 5), (600, 30), (3600, 60))
    unit = next((unit for end, unit in steps if seconds < end), 600)
    return f"about {time_in_words(float(unit * round(seconds / unit)))}"


class Telling:
    """What is told of the work at hand: on a terminal in one line with a bar, which is rewritten;
    elsewhere in a line after `TOLD_FROM` seconds, and in one each `TOLD_EVERY`."""

    def __init__(self, parts: Mapping[str, float]):
        """`parts`: of a command, in their order, with the seconds that each is expected to take;
        empty for work that is not divided."""
        self.parts = dict(parts)
        self._begun, self._what = 0, ""
        self._share: float | None = None
        self._began = self._end = self._last_line = time.monotonic()
        self._reached, self._wait = 0.0, TOLD_FROM

    def begin(self, part: str, said: str) -> None:
        """A part begins: a line says what it is, and how long it and all that is left take."""
        seconds, self._begun = self.parts[part], 1 + list(self.parts).index(part)
        self._end, self._what = time.monotonic() + seconds, ""
        whole = f"; {about(self._left())} with all that follows" if self._later() else ""
        announce(f"{self._text()}: {said} {about(seconds).capitalize()}{whole}.")

    def tell(
        self,
        what: str,
        share: float | None,
        left: float | None,
        is_whole: bool,
        tenth: bool = False,
    ) -> None:
        """Say what is being done.

        Args:
            share: of `what` that is done, in [0, 1].
            left: seconds until it is; None where that is not known.
            is_whole: whether the part, or work that is not divided, ends with it.
            tenth: whether another tenth of work that is not divided is done: it is told early.
        """
        now = time.monotonic()
        if left is not None:
            self._end = now + left if is_whole else max(self._end, now + left)
        self._what, self._share = what, share if is_whole else None
        wait = TOLD_FROM if tenth and not self.parts else self._wait
        if self._time() and now >= self._last_line + wait and not CONSOLE.is_terminal:
            self._last_line, self._wait = now, TOLD_EVERY
            announce(f"{self._text()}, {self._time()}.")

    def drawn(self) -> Table:
        """The line of a terminal, in any width: nerfstudio's console takes all for 120 columns."""
        line = Table.grid(padding=(0, 1), expand=True)
        line.width = min(CONSOLE.width, shutil.get_terminal_size().columns - 1)
        line.add_column(no_wrap=True, overflow="ellipsis", ratio=3)
        line.add_column(ratio=2)
        line.add_column(no_wrap=True, justify="right")
        spent, left = time.monotonic() - self._began, self._left()
        share = None if self.parts else self._share
        share = spent / (spent + left) if share is None and left else share
        self._reached = max(self._reached, share or 0.0)
        bar = ProgressBar(1.0, self._reached, pulse=share is None)
        line.add_row(Text(self._text(), "green"), bar, self._time())
        return line

    def _text(self) -> str:
        if not self._begun:
            return self._what
        name = f"Part {self._begun} of {len(self.parts)}, {list(self.parts)[self._begun - 1]}"
        return f"{name}: {self._what}" if self._what else name

    def _later(self) -> float:
        """Seconds that the parts after this one are expected to take."""
        return sum(list(self.parts.values())[self._begun :], 0.0)

    def _left(self) -> float:
        return max(0.0, self._end - time.monotonic()) + self._later()

    def _time(self) -> str:
        return f"{about(left)} left" if (left := self._left()) >= 1 else ""


_TELLING = ContextVar[Telling | None]("_TELLING", default=None)


@contextmanager
def telling(parts: Mapping[str, float] | None = None) -> Iterator[tuple[Telling, bool]]:
    """What tells of the work within, and whether it is for this work alone: one line tells of all
    that a command does. `parts`: of a command that tells itself what it does next."""
    if (outer := _TELLING.get()) is not None:
        yield outer, False
        return
    shown = Telling(parts or {})
    token = _TELLING.set(shown)
    line: Any = nullcontext()
    if CONSOLE.is_terminal:
        how: dict[str, Any] = {"console": CONSOLE, "transient": True, "refresh_per_second": 2}
        line = Live(get_renderable=shown.drawn, **how)
    try:
        with line:
            yield shown, not parts
    finally:
        _TELLING.reset(token)


def says_what_is_next() -> bool:
    """Whether the command at work has parts: those say nothing of commands to type."""
    return (shown := _TELLING.get()) is not None and bool(shown.parts)


@contextmanager
def progress_over(total: int, label: str, alike: bool = True) -> Iterator[Any]:
    """As `progress_with_time_left`; calling what is yielded advances by one, up to the total."""
    with progress_with_time_left(label, alike) as show:
        show(0, total)
        done = count(1)
        yield lambda: show(min(next(done), total), total)


@contextmanager
def progress_with_time_left(label: str, alike: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Tells how far work is and when it ends; what is yielded takes what is done and the total.
    Where not all parts are `alike`, so that the first say nothing of the others, no time is told.
    """
    with telling() as (shown, is_whole):
        seen = list[tuple[float, int]]()

        def show(done: int, total: int) -> None:
            seen.append((time.monotonic(), done))
            left = seconds_left(seen, total) if alike else None
            what = f"{label.rstrip('.')}, {done} of {total}"
            shown.tell(what, done / max(total, 1), left, is_whole)

        yield show


def seconds_left(seen: Sequence[tuple[float, int]], total: int) -> float | None:
    """Seconds until `total` parts are done, at the pace of the last two thirds of what was seen:
    the first parts compile and read what others find. None before there is a pace. `seen`: times
    in seconds, each with the number of parts that were done."""
    (began, before), (now, done) = seen[len(seen) // 3], seen[-1]
    return (now - began) * (total - done) / (done - before) if done > before else None
