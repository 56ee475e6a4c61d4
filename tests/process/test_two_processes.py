"""Two calls of `desplat-process` with one output do not share a database."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.commands.process import run
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.process import process
from desplat_ns.process.request import Request
from tests.helpers.other_process import running

AT_WORK = """
from pathlib import Path
from desplat_ns.commands.process import run
from desplat_ns.process import process
from desplat_ns.process.request import Request
process.best_attempt = lambda task: wait()
run(Request(Path({photos!r}), Path({output!r}), threads=1))
"""


@pytest.mark.slow
def test_the_second_is_refused_and_goes_on_once_the_first_was_killed(
    tmp_path: Path, photo_writer, checkout: Path, monkeypatch: pytest.MonkeyPatch
):
    photos, output = tmp_path / "photos", tmp_path / "out"
    for seed, name in enumerate("abc"):
        photo_writer(photos / f"{name}.png", 60, 40, seed=seed)
    request = Request(photos, output, threads=1)
    code = AT_WORK.format(photos=str(photos), output=str(output))
    with running(code, checkout) as first:
        with pytest.raises(ConfigError, match=rf"Process {first.pid} is at work in '{output}'"):
            run(request)
        first.kill()
        first.wait()

        def nothing_more(_: object) -> None:
            raise CaptureError("went on")

        monkeypatch.setattr(process, "best_attempt", nothing_more)
        with pytest.raises(CaptureError, match="went on"):
            run(request)
