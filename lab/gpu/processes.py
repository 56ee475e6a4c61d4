"""A part's process: started, waited for until its deadline, ended with all that it started."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from lab.documents import CHECKOUT
from lab.gpu.plan import Job, Part
from lab.gpu.records import FAILED, LATE, MEASURED, Record, without_places

LOG_LINES = 25
"""Of what a part printed before it failed."""

GRACE = 2.0
"""Seconds between asking a process to end and ending it."""


class PartProcess:
    """One part at work."""

    def __init__(self, part: Part, job: Job, ends: float, environment: dict[str, str]) -> None:
        """Args:
        ends: `time.monotonic()` at which the whole run is over.
        environment: variables of this part alone.
        """
        self.part, self._started = part, time.monotonic()
        self._ends = min(self._started + part.deadline, ends)
        folder = job.folder / part.name
        folder.mkdir(parents=True, exist_ok=True)
        self._target, self._log = folder / "figures.json", folder / "log.txt"
        self._error = self._target.with_suffix(".error")
        for old in (self._target, self._error):
            old.unlink(missing_ok=True)
        text = json.dumps(asdict(job) | {"case": part.name.partition(".")[2]})
        command = [sys.executable, "-m", "lab.gpu.part", part.name, str(self._target), text]
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                command,
                cwd=CHECKOUT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | _import_path() | environment,
                start_new_session=True,
            )

    def wait(self) -> Record:
        """Its record, once it has ended or is beyond its deadline."""
        try:
            code = self._process.wait(max(0.0, self._ends - time.monotonic()))
        except subprocess.TimeoutExpired:
            self.end()
            return self._record(LATE, f"ended after {self._ends - self._started:.0f} s")
        self.end()  # what it may have left running
        if code == 0:
            return self._record(MEASURED, "")
        return self._record(FAILED, self._reason(code))

    def end(self) -> None:
        """End the process and all that it started; nothing happens where none is left."""
        for way in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, way)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(GRACE)

    def _reason(self, code: int) -> str:
        if self._error.exists():
            return without_places(json.loads(self._error.read_text("utf8")))
        return f"its process was ended by signal {-code}" if code < 0 else f"exit status {code}"

    def _record(self, state: str, why: str) -> Record:
        figures = json.loads(self._target.read_text("utf8")) if self._target.exists() else {}
        if state == MEASURED and not figures:
            state, why = FAILED, "it gave no figures"
        return Record(
            state=state,
            seconds=round(time.monotonic() - self._started, 1),
            deadline=self.part.deadline,
            why=why,
            figures=figures,
            log=[] if state == MEASURED else _last_lines(self._log),
        )


def _import_path() -> dict[str, str]:
    """What this process imports from, for its children: the checkout first."""
    places = [str(CHECKOUT), *(os.path.abspath(place) for place in sys.path)]
    return {"PYTHONPATH": os.pathsep.join(dict.fromkeys(places)), "PYTHONUNBUFFERED": "1"}


def _last_lines(log: Path) -> list[str]:
    text = log.read_text("utf8", errors="replace")
    lines = [line.rstrip() for line in text.replace("\r", "\n").splitlines()]
    return [without_places(line)[:300] for line in lines if line.strip()][-LOG_LINES:]
