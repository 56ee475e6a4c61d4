"""The first stop signal asks, the next one ends; asked to end at once, the first one ends."""

import os
import signal
import subprocess
import sys

import pytest

from desplat_ns.training.stop_signals import STOP_SIGNALS, on_stop_signal

WAITING = """
import os, sys, time
from desplat_ns.training.stop_signals import on_stop_signal

with on_stop_signal(lambda name: False):
    print("ready", flush=True)
    for _ in range(600):  # a signal that comes just before a sleep begins is seen after it
        time.sleep(0.1)
"""


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_the_first_signal_calls_what_was_given_and_what_was_before_comes_back(number):
    before, causes = signal.getsignal(number), []
    with on_stop_signal(lambda name: not causes.append(name)):
        os.kill(os.getpid(), number)
        assert signal.getsignal(number) == before
    assert causes == ["Ctrl+C" if number == signal.SIGINT else number.name]
    assert signal.getsignal(number) == before


def test_asked_to_end_at_once_a_termination_is_one():
    with subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.terminate()
        assert process.wait(60) == -signal.SIGTERM
