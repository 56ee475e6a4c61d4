"""What is said on the console: lines, lists of names, progress bars."""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from itertools import count
from typing import Any

from nerfstudio.utils.rich_utils import CONSOLE
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from desplat_ns.core.errors import printable

LISTED_NAMES = 10
"""So many names are listed in an error; the rest is counted."""
PART = ContextVar("PART", default="")
"""What lines of progress begin with, as `Part 1 of 3: `, in a command that says itself what is
next."""
TOLD_FROM, TOLD_EVERY = 5.0, 60.0
"""Seconds after which the time that is left is told first, and from one line to the next."""


def announce(line: str, warning: bool = False) -> None:
    """Print one line on nerfstudio's console; paths stay whole, brackets in them are kept, control
    characters are shown. One that cannot be written to, such as a log on a full disk, is no reason
    to stop."""
    style = "yellow" if warning else None
    with suppress(OSError):
        CONSOLE.print(escape(printable(line)), style=style, soft_wrap=True, highlight=False)


@cache
def announce_once(line: str, warning: bool = False) -> None:
    """As `announce`, once in a process: a capture is read by the survey and by the data manager."""
    announce(line, warning)


def list_names(names: Iterable[str], at_most: int = LISTED_NAMES) -> str:
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


@contextmanager
def progress_over(total: int, label: str) -> Iterator[Any]:
    """A bar on the console with the time left; calling what is yielded advances it by one."""
    with progress_with_time_left(label) as show:
        show(0, total)
        done = count(1)
        yield lambda: show(next(done), total)


@contextmanager
def progress_with_time_left(label: str, alike: bool = True) -> Iterator[Callable[[int, int], None]]:
    """A bar on the console with the time left; what is yielded takes what is done and the total.
    Where no bar can be drawn, as in a log, the time is told in lines; where not all parts are
    `alike`, so that the first say nothing of the others, it is not told."""
    label = f"{PART.get()}{label}"
    columns = (
        TextColumn("[progress.description]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=CONSOLE, transient=True) as bar:
        task = bar.add_task(f"[green]{escape(label)}", total=None, left="")
        seen, next_line = list[tuple[float, int]](), time.monotonic() + TOLD_FROM

        def show(done: int, total: int) -> None:
            nonlocal next_line
            seen.append((now := time.monotonic(), done))
            left = seconds_left(seen, total) if alike else None
            text = f"{about(left)} left" if left else ""
            bar.update(task, completed=done, total=total, left=text)
            if left and now >= next_line and not CONSOLE.is_terminal:
                next_line = now + TOLD_EVERY
                announce(f"{label.rstrip('.')}: {text} on this machine.")

        yield show


def seconds_left(seen: Sequence[tuple[float, int]], total: int) -> float | None:
    """Seconds until `total` parts are done, at the pace of the last two thirds of what was seen:
    the first parts compile and read what others find. None before there is a pace. `seen`: times
    in seconds, each with the number of parts that were done."""
    (began, before), (now, done) = seen[len(seen) // 3], seen[-1]
    return (now - began) * (total - done) / (done - before) if done > before else None
