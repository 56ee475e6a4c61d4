from __future__ import annotations

import importlib
from types import ModuleType

import pytest

from desplat_ns.errors import DeSplatError


@pytest.fixture(scope="module")
def run(checkout) -> ModuleType:
    """demo/run.py, which belongs to no package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(checkout / "demo")
        return importlib.import_module("run")


@pytest.fixture
def execute(run):
    return run.execute


def test_a_folder_that_the_demo_did_not_make_is_left_alone(run, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DeSplatError, match="was not made by the demo"):
        run.start_anew(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_folder_of_an_earlier_demo_is_emptied(run, tmp_path):
    folder = tmp_path / "output"
    run.start_anew(folder)
    (folder / "sheet.png").touch()
    run.start_anew(folder)
    assert [path.name for path in folder.iterdir()] == [run.MARK]


def test_a_failing_command_shows_its_last_lines_and_its_log(execute, tmp_path, capsys):
    log = tmp_path / "train.log"
    with pytest.raises(DeSplatError, match=r"no such flag(.|\n)*train\.log"):
        execute(["python", "-c", "import sys; sys.exit('no such flag')"], log, "Training")
    assert "no such flag" in log.read_text()
    assert "import sys" in capsys.readouterr().out


def test_progress_is_read_from_nerfstudios_lines(execute, tmp_path, capsys):
    steps = "for i in range(0, 40, 5): print(f'{i} ({i / 0.4:.2f}%)   12 ms')"
    execute(["python", "-c", steps], tmp_path / "log", "Training", 40)
    printed = capsys.readouterr().out.splitlines()
    assert printed[1:] == [f"Training {i}/40" for i in range(5, 40, 5)]


def test_a_command_that_is_not_installed_is_an_error_that_says_what_to_type(execute, tmp_path):
    with pytest.raises(DeSplatError, match="make demo"):
        execute(["ns-nothing"], tmp_path / "log", "Training")
