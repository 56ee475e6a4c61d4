"""Records come back as they were written, and are not mixed with those of other code."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

import desplat_ns
from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.studies.machine import DIRTY, code_version, short
from desplat_ns.tools.studies.records import FILE, Record, load, open_records, save

SCORES = {"psnr": 25.5, "backend": "numba"}
OURS = Record(code_version(), "2026-11-27", "desplat", "--steps 9", "fox", 42, SCORES, 12.5, "CPU")


def test_records_come_back_and_the_later_one_of_a_run_counts(tmp_path: Path):
    file, other, again = tmp_path / FILE, replace(OURS, seed=43), replace(OURS, seconds=1.0)
    assert load(file) == {}
    save(file, [OURS, other, again])
    assert len(file.read_text().splitlines()) == 3
    assert load(file) == {OURS.key: again, other.key: other}


@pytest.mark.parametrize("text", ["{", "[]\n", '{"seed": 1}\n', "\xff"])
def test_a_damaged_file_is_an_error(tmp_path: Path, text: str):
    (tmp_path / FILE).write_text(text, "latin1")
    with pytest.raises(ConfigError, match=FILE):
        load(tmp_path / FILE)


def test_a_folder_with_something_else_or_of_other_code_is_refused(tmp_path: Path):
    assert open_records(tmp_path / "new") == {}
    (tmp_path / "photo.png").touch()
    with pytest.raises(ConfigError, match=r"photo\.png"):
        open_records(tmp_path)
    save(tmp_path / FILE, [OURS])
    assert len(open_records(tmp_path)) == 1
    save(tmp_path / FILE, [replace(OURS, commit="other")])
    with pytest.raises(ConfigError, match="other"):
        open_records(tmp_path)


def git(folder: Path, *arguments: str) -> str:
    author = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", "-C", str(folder), *author, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_a_record_names_the_commit_of_the_packages_own_files(tmp_path: Path, monkeypatch):
    package, version = tmp_path / "package", f"desplat-ns {desplat_ns.__version__}"
    package.mkdir()
    (package / "__init__.py").touch()
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "--message", "first")
    (tmp_path / "README").write_text("beside the package")
    commit = git(package, "rev-parse", "HEAD")
    assert code_version(package) == commit and short(commit) == commit[:7]
    (package / "new.py").touch()
    assert code_version(package) == commit + DIRTY
    installed = package / "env" / "package"
    installed.mkdir(parents=True)
    (installed / "__init__.py").touch()
    assert code_version(installed) == short(version) == version, "git does not track it"
    monkeypatch.setenv("PATH", "")
    assert code_version(package) == version, "without git"
