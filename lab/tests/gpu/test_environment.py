from __future__ import annotations

import importlib.util
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

import pytest

from lab.gpu import environment, wheels
from lab.tests.gpu.test_wheels import a_wheel

HERE = sys.version_info[:2]

HAS_PIP = any(distribution.name == "pip" for distribution in distributions())
"""Not by `find_spec("pip")`: on Python 3.10 setuptools then leaves the process to the standard
library's distutils, and fails when it is imported later."""


def a_collection(folder: Path, python: str = ".".join(map(str, HERE))) -> Path:
    folder.mkdir()
    wheel = a_wheel(folder / "thing-1.0-py3-none-any.whl", lines=3)
    wheels.pack([wheel], folder / wheels.ARCHIVE)
    wheel.unlink()
    (folder / wheels.MADE_FOR).write_text(f"{python}\n")
    return folder


def test_a_missing_folder_is_named_with_what_makes_one(tmp_path: Path, capsys):
    gone = tmp_path / "gone"
    assert environment.main([str(gone), str(tmp_path / "venv")]) == 1
    said = capsys.readouterr().err
    assert f"WHEELS={gone}" in said and "lab.gpu.collect" in said
    assert not (tmp_path / "venv").exists()


def test_a_collection_that_was_not_finished_is_no_collection(tmp_path: Path):
    folder = a_collection(tmp_path / "wheels")
    (folder / wheels.MADE_FOR).unlink()
    with pytest.raises(environment.NoEnvironment, match="as a whole collection does"):
        environment.check_folder(folder, HERE)


def test_a_folder_that_is_too_large_is_refused(tmp_path: Path, monkeypatch):
    folder = a_collection(tmp_path / "wheels")
    monkeypatch.setattr(environment, "LIMIT", 10)
    with pytest.raises(environment.NoEnvironment, match=r"takes .* MB, more than"):
        environment.check_folder(folder, HERE)


def test_wheels_of_another_python_are_refused(tmp_path: Path):
    folder = a_collection(tmp_path / "wheels", "3.12")
    assert environment.check_folder(folder, (3, 12)) == folder / wheels.ARCHIVE
    with pytest.raises(environment.NoEnvironment, match=r"for Python 3\.12 and this is"):
        environment.check_folder(folder, (3, 10))


def test_a_python_without_torch_is_refused(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(environment.NoEnvironment, match=r"has no torch.*PYTHON="):
        environment.check_torch()


@pytest.mark.slow
@pytest.mark.skipif(not HAS_PIP, reason="this environment has no pip")
def test_an_environment_has_the_wheels_and_sees_this_pythons_packages(tmp_path: Path):
    folder = a_collection(tmp_path / "wheels")
    place = tmp_path / "venv"
    environment.make_environment(folder / wheels.ARCHIVE, place, checkout=None)
    program = "import thing.part_0, numpy, sys; print(thing.part_0.value_2, numpy.__file__)"
    done = subprocess.run(
        [place / "bin" / "python", "-c", program],
        cwd=tmp_path,
        env={"PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    value, numpy_file = done.stdout.split(maxsplit=1)
    assert int(value) == 2 * 7919 and Path(numpy_file.strip()).is_relative_to(sys.prefix)
