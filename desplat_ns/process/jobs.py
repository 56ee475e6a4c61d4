"""Starts the worker for one stage, shows how far it is, and says what happened if it fails."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import desplat_ns
from desplat_ns.console import progress_with_time_left
from desplat_ns.errors import DeSplatError
from desplat_ns.process.folder import Folder, disk_full, disk_is_full

COMMAND = (sys.executable, "-m", "desplat_ns.process.worker")


def run_job(folder: Folder, label: str, job: str, arguments: Mapping[str, Any]) -> Any:
    """The result of a job of `worker.JOBS`.

    Args:
        label: what the bar says.
        arguments: of the job; paths are made absolute.

    Raises:
        DeSplatError: the worker failed or crashed; what is done is kept.
    """
    told = {name: str(v.resolve()) if isinstance(v, Path) else v for name, v in arguments.items()}
    folder.work.mkdir(parents=True, exist_ok=True)
    begin = folder.log.stat().st_size if folder.log.exists() else 0
    with progress_with_time_left(label) as show, folder.log.open("ab") as log:
        process = subprocess.Popen(
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            encoding="utf8",
            cwd=folder.work,
            env=_environment(),
        )
        try:
            last = _talk(process, json.dumps({"job": job, **told}), show)
            status = process.wait()
        finally:
            process.kill()
            process.communicate()
    if status == 0 and "result" in last:
        return last["result"]
    raise _failure(folder, label, last.get("error", ""), status, begin)


def _talk(
    process: subprocess.Popen[str], job: str, show: Callable[[int, int], None]
) -> dict[str, Any]:
    """The last thing that the worker says."""
    assert process.stdin is not None and process.stdout is not None
    try:
        process.stdin.write(job + "\n")
        process.stdin.flush()
    except BrokenPipeError:
        return {}
    told: dict[str, Any] = {}
    for line in process.stdout:
        try:
            told = json.loads(line)
        except ValueError:
            return {}  # cut off by a crash
        if "total" in told:
            show(told["done"], told["total"])
    return told


def _environment() -> dict[str, str]:
    """The worker finds this very package, wherever it starts."""
    package = str(Path(desplat_ns.__file__).resolve().parent.parent)
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_WAIT_POLICY": "passive"}


def _failure(folder: Folder, label: str, error: str, status: int, begin: int) -> DeSplatError:
    if disk_is_full(folder.output):
        return disk_full(folder.output)
    said = error or _last_complaint(folder.log, begin)
    went_on = "What is done is kept: the same command goes on where it stopped."
    if status < 0:
        name = signal.Signals(-status).name
        reason = f"pycolmap was ended by {name} during '{label}'"
        if name == "SIGKILL":
            reason += ", as systems do where memory runs out"
        advice = "If that happens again: fewer --threads, or a smaller --longest-side."
    else:
        reason, advice = f"pycolmap failed during '{label}'", f"Its log is {folder.log}."
    return DeSplatError(f"{reason}{f' ({said})' if said else ''}. {went_on} {advice}")


def _last_complaint(log: Path, begin: int) -> str:
    """The last line of the log since `begin` that tells of an error, if any."""
    with log.open("rb") as file:
        file.seek(begin)
        lines = file.read().decode("utf8", "replace").splitlines()
    bad = [line for line in lines if line[:1] in ("E", "F") or "Error" in line]
    return bad[-1].partition("] ")[2] or bad[-1] if bad else ""
