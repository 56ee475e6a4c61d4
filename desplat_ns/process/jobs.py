"""Runs one stage of pycolmap in a process of its own, the worker: a crash there is an error message
here."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from desplat_ns.console import progress_with_time_left
from desplat_ns.errors import DeSplatError
from desplat_ns.files.whole import disk_is_full
from desplat_ns.process.workspace import Workspace, disk_full


def run_job(folder: Workspace, label: str, job: str, arguments: Mapping[str, Any]) -> Any:
    """What a function returns that is called in another process.

    Args:
        label: what the bar says.
        job: dotted name of the function; it is imported there and not here. Besides its arguments
            it gets `progress`, to be called with what is done and what there is to do.
        arguments: by name; paths are made absolute.

    Raises:
        DeSplatError: the function failed or crashed; what is done is kept.
    """
    absolute = {name: v.resolve() if isinstance(v, Path) else v for name, v in arguments.items()}
    folder.work.mkdir(parents=True, exist_ok=True)
    begin = folder.log.stat().st_size if folder.log.exists() else 0
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read as the other process starts
    spawned = multiprocessing.get_context("spawn")
    receiver, sender = spawned.Pipe(duplex=False)
    process = spawned.Process(target=_work, args=(sender, folder.log.resolve(), job, absolute))
    with progress_with_time_left(label) as show, receiver:
        try:
            process.start()
            sender.close()
            kind, content = _listen(receiver, show)
            process.join()
        finally:
            if process.pid is not None:
                process.kill()
                process.join()
    if process.exitcode == 0 and kind == "result":
        return content
    error = content if kind == "error" else ""
    raise _failure(folder, label, error, process.exitcode or 0, begin)


def _listen(receiver: Connection, show: Callable[[int, int], None]) -> tuple[str, Any]:
    """The last message: "result" or "error" with its content; "progress" after a crash."""
    kind, content = "progress", None
    while True:
        try:
            kind, content = receiver.recv()
        except (EOFError, OSError):
            return kind, content
        if kind == "progress":
            show(*content)


def _work(sender: Connection, log: Path, job: str, arguments: Mapping[str, Any]) -> None:
    """The other process: what it prints, pycolmap included, goes to the log."""
    with log.open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.chdir(log.parent)
    _end_with_the_parent()
    lock = Lock()

    def tell(kind: str, content: Any) -> None:
        with lock:
            sender.send((kind, content))

    try:
        module, _, name = job.rpartition(".")
        do = getattr(import_module(module), name)
        tell("result", do(**arguments, progress=lambda *counts: tell("progress", counts)))
    except Exception as error:
        traceback.print_exc()
        tell("error", f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}")
        sys.exit(1)


def _end_with_the_parent() -> None:
    """On Linux at once, even while pycolmap works and no thread of Python gets its turn."""
    if sys.platform == "linux":
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)
    Thread(target=_end_after_the_parent, daemon=True).start()


def _end_after_the_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a process that another one started is here"
    parent.join()
    os._exit(1)


def _failure(folder: Workspace, label: str, error: str, status: int, begin: int) -> DeSplatError:
    if disk_is_full(folder.output):
        return disk_full(folder.output)
    said = error or _last_complaint(folder.log, begin)
    went_on = "What is done is kept: the same command goes on where it stopped."
    if status < 0:
        name = signal.Signals(-status).name
        reason = f"pycolmap was ended by {name} during '{label}'"
        if name == "SIGKILL":
            reason += ", as systems do where memory runs out"
        advice = "If that happens again: fewer --threads, or another folder with a smaller "
        advice += "--longest-side."
    else:
        reason, advice = f"pycolmap failed during '{label}'", f"Its log is {folder.log}."
    return DeSplatError(f"{reason}{f' ({said})' if said else ''}. {went_on} {advice}")


def _last_complaint(log: Path, begin: int) -> str:
    """The last line of the log since `begin` that tells of an error, if any."""
    if not log.is_file():  # the process ended before it wrote any
        return ""
    with log.open("rb") as file:
        file.seek(begin)
        lines = file.read().decode("utf8", "replace").splitlines()
    bad = [line for line in lines if line[:1] in ("E", "F") or "Error" in line]
    return bad[-1].partition("] ")[2] or bad[-1] if bad else ""
