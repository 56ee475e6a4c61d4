"""One stage of pycolmap in a process of its own: a crash there is an error message here.

    python -m desplat_ns.process.worker

reads `{"job": name, ...}` as one line, writes lines `{"done": n, "total": n}` and at the end
`{"result": ...}` or `{"error": ...}`. It ends when its input does, so that it does not outlive
whoever started it. What pycolmap prints goes to standard error.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from desplat_ns.process.cameras import Camera
from desplat_ns.process.features import Progress, find_features
from desplat_ns.process.mapping import map_photos
from desplat_ns.process.matches import match_photos
from desplat_ns.process.recipes import RECIPES
from desplat_ns.process.undistortion import undistort

Job = Mapping[str, Any]


def _features(job: Job, progress: Progress) -> Any:
    cameras = [Camera(**{**c, "copies": tuple(c["copies"])}) for c in job["cameras"]]
    masks = Path(job["masks"]) if job["masks"] else None
    return find_features(
        Path(job["database"]),
        Path(job["photos"]),
        cameras,
        masks,
        RECIPES[job["recipe"]],
        job["threads"],
        progress,
    )


def _matches(job: Job, progress: Progress) -> Any:
    database, pairs_file = Path(job["database"]), Path(job["pairs_file"])
    recipe = RECIPES[job["recipe"]]
    return match_photos(database, job["how"], pairs_file, recipe, job["threads"], progress)


def _mapping(job: Job, progress: Progress) -> Any:
    database, photos, models = (Path(job[name]) for name in ("database", "photos", "models"))
    return map_photos(database, photos, models, RECIPES[job["recipe"]], job["threads"], progress)


def _undistortion(job: Job, progress: Progress) -> Any:
    model, photos, output = (Path(job[name]) for name in ("model", "photos", "output"))
    side, threads = job["longest_side"], job["threads"]
    return undistort(model, photos, output, job["names"], side, threads, progress)


JOBS: dict[str, Callable[[Job, Progress], Any]] = {
    "features": _features,
    "matching": _matches,
    "mapping": _mapping,
    "undistortion": _undistortion,
}


def main() -> int:
    """Do the job that standard input names. Returns the exit status."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf8")
    os.dup2(2, 1)
    lock = Lock()

    def tell(**what: Any) -> None:
        with lock:
            channel.write(json.dumps(what) + "\n")
            channel.flush()

    _end_with_the_parent()
    job = json.loads(sys.stdin.readline())
    Thread(target=_end_with_the_input, daemon=True).start()
    try:
        result = JOBS[job["job"]](job, lambda done, total: tell(done=done, total=total))
    except Exception as error:
        traceback.print_exc()
        tell(error=f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}")
        return 1
    tell(result=result)
    return 0


def _end_with_the_parent() -> None:
    """On Linux at once, even while pycolmap works and no thread of Python gets its turn."""
    if sys.platform == "linux":
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)


def _end_with_the_input() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
