"""The commit that a figure is said to be of is that of the package's own files."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import desplat_ns
from desplat_ns.studies.machine import DIRTY, code_version, short

VERSION = f"desplat-ns {desplat_ns.__version__}"


def git(folder: Path, *arguments: str) -> str:
    author = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", "-C", str(folder), *author, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package in a checkout of one commit, with a document beside it."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "--message", "first")
    return folder


def test_it_is_the_commit_of_the_checkout_whatever_lies_beside_the_package(package: Path):
    (package.parent / "README").write_text("changed")
    commit = git(package, "rev-parse", "HEAD")
    assert code_version(package) == commit
    assert short(commit) == commit[:7]


@pytest.mark.parametrize("name", ["__init__.py", "new.py"])
def test_a_file_of_the_package_that_differs_marks_it(package: Path, name: str):
    (package / name).write_text("x = 1")
    assert code_version(package) == git(package, "rev-parse", "HEAD") + DIRTY


def test_a_package_that_git_does_not_track_gives_its_version(package: Path, monkeypatch):
    installed = package.parent / "env" / "package"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    assert code_version(installed) == short(VERSION) == VERSION
    monkeypatch.setenv("PATH", "")
    assert code_version(package) == VERSION, "without git"
