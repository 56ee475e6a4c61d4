"""The demo replaces nothing that it did not make, and shows why a command of it failed."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

from desplat_ns.core.errors import DeSplatError


@pytest.fixture(scope="module")
def run(checkout: Path) -> ModuleType:
    """demo/run.py, which belongs to no package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(checkout / "demo")
        return importlib.import_module("run")


def test_only_a_folder_that_the_demo_made_is_emptied(run: ModuleType, tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DeSplatError, match="demo"):
        run.start_anew(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
    folder = tmp_path / "output"
    run.start_anew(folder)
    (folder / "sheet.png").touch()
    run.start_anew(folder)
    assert [path.name for path in folder.iterdir()] == [run.MARK]


def test_a_failing_command_shows_its_last_lines_and_its_log(run: ModuleType, tmp_path: Path):
    log = tmp_path / "train.log"
    with pytest.raises(DeSplatError, match=r"no such flag(.|\n)*train\.log"):
        run.execute(["python", "-c", "import sys; sys.exit('no such flag')"], log, "Training")
    assert "no such flag" in log.read_text()
    with pytest.raises(DeSplatError, match="make demo"):
        run.execute(["ns-nothing"], log, "Training")
