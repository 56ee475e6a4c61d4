"""Ctrl+C, a closed terminal and what a batch system sends: the first signal asks a run to stop, the
next one ends it."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl+C; what a batch system or a shutdown sends before it kills; a terminal that is closed."""


@contextmanager
def on_stop_signal(stop: Callable[[str], None]) -> Iterator[None]:
    """Within, the first of `STOP_SIGNALS` calls `stop` with its name; the next ends the process.
    Nothing is caught outside of the main thread, which alone gets signals, nor SIGHUP where nohup
    has it ignored."""
    previous = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    if previous[signal.SIGHUP] is signal.SIG_IGN:
        del previous[signal.SIGHUP]
    if None in previous.values() or threading.current_thread() is not threading.main_thread():
        yield
        return

    def restore() -> None:
        for number, handler in previous.items():
            signal.signal(number, handler)

    def handle(number: int, _: object) -> None:
        restore()
        stop("Ctrl+C" if number == signal.SIGINT else signal.Signals(number).name)

    for number in previous:
        signal.signal(number, handle)
    try:
        yield
    finally:
        restore()
