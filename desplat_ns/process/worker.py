"""Runs what speaks to pycolmap in a process of its own, the worker: a crash there is an error
message here."""

from __future__ import annotations

import multiprocessing
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from desplat_ns.console import progress_with_time_left
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.files.whole import FEW_BYTES, free_bytes

LOG = "colmap.log"
"""File in the work folder with all that pycolmap prints."""

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, what is done of it, and what there is to do."""


def in_worker(work: Path, do: Callable[..., Any], *arguments: Any) -> Any:
    """What `do(*arguments, progress)` returns in another process, with bars of its progress.

    Args:
        work: the work folder.
        do: a function of a module; `progress` is a `Progress`.

    Raises:
        DeSplatError: the function raised it, failed otherwise, or crashed.
    """
    work.mkdir(parents=True, exist_ok=True)
    log = (work / LOG).resolve()
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read as the other process starts
    spawned = multiprocessing.get_context("spawn")
    receiver, sender = spawned.Pipe(duplex=False)
    process = spawned.Process(target=_work, args=(sender, log, do, arguments))
    stage, show, kind, content = "", None, "", ""
    with ExitStack() as bar, receiver:
        try:
            process.start()
            sender.close()
            with suppress(EOFError, OSError):  # it has crashed
                while kind not in ("result", "error"):
                    kind, content = receiver.recv()
                    if kind == "progress":
                        if show is None or content[0] != stage:
                            bar.close()
                            stage = content[0]
                            show = bar.enter_context(progress_with_time_left(stage))
                        show(*content[1:])
            process.join()
        finally:
            if process.pid is not None:
                process.kill()
                process.join()
    if kind == "result":
        return content
    if isinstance(content, DeSplatError):
        raise content
    if free_bytes(work) < FEW_BYTES:
        raise unwritable(work.parent)
    said = content if kind == "error" else f"exit code {process.exitcode}"
    raise DeSplatError(
        f"pycolmap failed during '{stage}' ({said}). What is "
        "done is kept: the same command goes on where it stopped. If that happens again, look at "
        f"{log}; where memory runs out, which exit code -9 may mean, use fewer --threads, or "
        "another folder with a smaller --longest-side."
    )


def _work(sender: Any, log: Path, do: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """The other process: what it prints, pycolmap included, goes to the log."""
    with log.open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a process that another one started is here"

    def end_with_the_parent() -> None:
        parent.join()
        os._exit(1)

    Thread(target=end_with_the_parent, daemon=True).start()
    lock = Lock()  # pycolmap calls back from threads of its own

    def tell(kind: str, content: Any) -> None:
        with lock:
            sender.send((kind, content))

    try:
        tell("result", do(*arguments, lambda *counts: tell("progress", counts)))
    except DeSplatError as error:
        tell("error", error)
    except Exception as error:
        traceback.print_exc()
        tell("error", f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}")
        sys.exit(1)


def unwritable(output: Path, error: Exception | None = None) -> DeSplatError:
    """What to say where writing failed."""
    if free_bytes(output) >= FEW_BYTES:
        return ConfigError(f"Nothing can be written to {output} ({error}). Name another folder.")
    return DeSplatError(
        f"The disk of {output} is full. What is done is kept: make room, and the same command goes "
        "on where it stopped. A smaller --longest-side, in another folder, needs less."
    )
