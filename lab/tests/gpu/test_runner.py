"""Runs of made-up parts, each in a real process of its own."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.backend.gsplat_kernels import build
from lab.gpu import plan
from lab.gpu.plan import KERNELS, LEAST, PARTS, TOTAL, Job, Part
from lab.gpu.records import FAILED, LATE, LEFT_OUT, MEASURED, NO_TIME, Run
from lab.gpu.runner import Runner, environment_of

PARTS_OF_TESTS = {
    "sound": (
        "def measure(job):\n    yield {'answer': 1}\n    yield {'answer': 42, 'case': job.case}"
    ),
    "raising": (
        "def measure(job):\n    yield {'half': 1}\n    print('a line before')\n"
        "    raise ValueError('no such thing in /some/where/file.txt')"
    ),
    "broken": "import a_module_that_is_not_there",
    "crashing": "import os, signal\ndef measure(job):\n    os.kill(os.getpid(), signal.SIGKILL)",
    "silent": "def measure(job):\n    yield from ()",
    "endless": (
        "import pathlib, subprocess, sys, time\ndef measure(job):\n"
        "    child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "    pathlib.Path(job.work, 'child').write_text(str(child.pid))\n"
        "    yield {'half': 1}\n    time.sleep(60)"
    ),
    "kernels": "raise RuntimeError('nvcc said no')",
}
"""By name, the module's text."""

Running = Callable[..., Run]


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Running:
    """`running(part, ..., seconds=30)`: a run of made-up parts; keeps what was written and said."""
    package = tmp_path / "parts_of_tests"
    package.mkdir()
    for name, text in {"__init__": "", **PARTS_OF_TESTS}.items():
        (package / f"{name}.py").write_text(text + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    job = Job("cpu", True, str(tmp_path / "work"), package=package.name)

    def run(*parts: Part, seconds: float = 30.0) -> Run:
        written: list[list[str]] = []
        runner = Runner(
            job,
            seconds,
            lambda run: written.append([record.state for record in run.parts.values()]),
            lambda line: None,
            parts,
        )
        ended = runner()
        assert len(written) == len(parts)  # whoever ends a run finds what it had
        return ended

    return run


def part(name: str, deadline: float = 20.0, needs_kernels: bool = False) -> Part:
    return Part(name, name, deadline, needs_kernels)


def test_the_last_figures_of_a_part_are_its_record(running: Running):
    record = running(part("sound.gpu")).parts["sound.gpu"]
    assert record.state == MEASURED and record.figures == {"answer": 42, "case": "gpu"}
    assert record.why == "" and record.log == [] and 0 < record.seconds < record.deadline


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("raising", "ValueError: no such thing in file.txt"),
        ("broken", "ModuleNotFoundError: No module named 'a_module_that_is_not_there'"),
        ("crashing", "its process was ended by signal 9"),
        ("silent", "it gave no figures"),
    ],
)
def test_a_part_that_fails_says_why_and_ends_no_other(running: Running, name: str, why: str):
    run = running(part(name), part("sound"))
    assert (run.parts[name].state, run.parts[name].why) == (FAILED, why)
    assert run.parts["sound"].state == MEASURED


def test_a_part_that_fails_keeps_what_it_had_and_its_last_lines(running: Running):
    record = running(part("raising")).parts["raising"]
    assert record.figures == {"half": 1}
    assert "a line before" in record.log and record.log[-1].startswith("ValueError: no such")
    assert not any("/some/where" in line for line in record.log)


def is_alive(process: int) -> bool:
    """Whether a process runs; one that has ended and was not asked for yet does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
def test_a_part_beyond_its_deadline_is_ended_with_all_that_it_started(
    running: Running, tmp_path: Path
):
    began = time.monotonic()
    run = running(part("endless", deadline=3.0), part("sound"))
    record = run.parts["endless"]
    assert (record.state, record.why) == (LATE, "ended after 3 s")
    assert record.figures == {"half": 1} and run.parts["sound"].state == MEASURED
    assert time.monotonic() - began < 30
    child = int((tmp_path / "work" / "child").read_text())
    assert not is_alive(child) and is_alive(os.getpid())


def test_parts_for_which_no_time_is_left_are_not_begun(running: Running):
    run = running(part("sound"), part("raising"), seconds=LEAST - 1)
    assert {record.state for record in run.parts.values()} == {NO_TIME}
    assert "s were left" in run.parts["sound"].why


def test_a_run_ends_a_part_although_its_own_deadline_is_later(running: Running):
    run = running(part("endless", deadline=100.0), seconds=LEAST + 2)
    assert run.parts["endless"].state == LATE and run.parts["endless"].seconds < 20


def test_without_kernels_only_the_parts_that_need_them_are_left_out(running: Running):
    needing = replace(part("raising"), needs_kernels=True)
    run = running(part("sound"), KERNELS, needing)
    states = [run.parts[name].state for name in ("sound", "kernels", "raising")]
    assert states == [MEASURED, FAILED, LEFT_OUT]
    assert "RuntimeError: nvcc said no" in run.parts["raising"].why


def test_every_part_has_a_module_and_a_deadline_within_the_run():
    folder = Path(__file__).parents[3] / "lab" / "gpu" / "parts"
    for part in PARTS:
        assert (folder / f"{part.name.partition('.')[0]}.py").is_file()
        assert 0 < part.deadline < TOTAL <= 600


@pytest.mark.parametrize(("jobs", "deadline"), [(14, 360.0), (2, 1980.0)])
def test_the_kernels_have_twice_the_time_that_they_are_expected_to_take(
    monkeypatch: pytest.MonkeyPatch, jobs: int, deadline: float
):
    monkeypatch.setattr(plan, "kernel_jobs", lambda: jobs)
    monkeypatch.setattr(build, "CPU_MINUTES", 33)
    assert plan.with_time_to_compile(KERNELS) == replace(KERNELS, deadline=deadline)


def test_the_compiler_and_the_training_beside_it_share_the_cores():
    cores = len(os.sched_getaffinity(0))
    training = environment_of(next(part for part in PARTS if part.name == "training.cpu"))
    jobs, threads = int(environment_of(KERNELS)["MAX_JOBS"]), int(training["NUMBA_NUM_THREADS"])
    assert 1 <= threads <= jobs and jobs + threads <= max(cores, 2)
