"""Tables end to end on generated scenes that lie as the published ones do."""

import json
from pathlib import Path

import pytest

from desplat_ns.tools.studies import runs
from desplat_ns.tools.studies.paper import METHODS, TABLES
from desplat_ns.tools.studies.records import FILE, Record, load
from desplat_ns.tools.studies.reproduce import Smoke, reproduce
from desplat_ns.tools.studies.runs import Run, execute
from lab.reproduce.data_sets import TINY, write_on_the_go, write_robustnerf
from lab.reproduce.smoke import GROUPS, missing_figures
from lab.synthetic import make_scene

pytestmark = [pytest.mark.usefixtures("tyro_may_build"), pytest.mark.slow]

SMOKE = Smoke(steps=4, side=48)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of each of two data sets."""
    folder, scene = tmp_path_factory.mktemp("data"), make_scene(TINY)
    write_robustnerf(scene, folder / "robustnerf" / "yoda")
    write_on_the_go(scene, folder / "on-the-go" / "patio_high")
    return folder


def test_a_killed_smoke_table_of_two_data_sets_goes_on_and_is_the_same(
    data: Path, tmp_path: Path, monkeypatch
):
    left = [2]

    def killed(run: Run, folder: Path) -> Record:
        if left[0] == 0:
            raise KeyboardInterrupt
        left[0] -= 1
        return execute(run, folder)

    def folder_of(name: str, do) -> Path:
        methods = (METHODS["desplat-paper"], METHODS["splatfacto"])
        monkeypatch.setattr(runs, "execute", do)
        return reproduce(TABLES["A7"], data, tmp_path / name, methods, 1, SMOKE)

    whole = json.loads((folder_of("whole", execute) / "table.json").read_text())
    assert {cell["scene"] for cell in whole["cells"]} == {"Yoda", "Patio-High", "mean"}
    assert {cell["metric"] for cell in whole["cells"]} == {
        "static_memory_mb",
        "distractor_memory_mb",
    }
    conditions = whole["conditions"]
    assert conditions["steps"] == [4] and conditions["versions"]
    assert "Patio-High" in conditions["scenes"][1] and " 0 points" in conditions["scenes"][1]
    assert not list(tmp_path.rglob("nerfstudio_models")), "nobody needs them"
    with pytest.raises(KeyboardInterrupt):
        folder_of("out", killed)
    assert len(load(tmp_path / "out" / FILE)) == 2
    again = json.loads((folder_of("out", execute) / "table.json").read_text())
    assert again["cells"] == whole["cells"]


def test_every_table_is_tried_and_a_figure_that_is_missing_is_named(tmp_path: Path):
    assert sorted(name for group in GROUPS for name in group) == sorted(TABLES)
    cells = [
        {"scene": scene.name, "method": method, "metric": "static_memory_mb"}
        for scene in TABLES["A7"].scenes
        for method in TABLES["A7"].methods
    ]
    content = {"cells": cells[1:], "conditions": {"LPIPS net": []}}
    (tmp_path / "table.json").write_text(json.dumps(content))
    assert missing_figures("A7", tmp_path)[0] == "A7 has no static_memory_mb of desplat on Statue."
