"""Data sets are read as they lie on the disk: names, camera models, and what COLMAP left out."""

from pathlib import Path

import pytest
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.tools.fetch.sources import SOURCES
from desplat_ns.tools.studies.methods import content_of
from desplat_ns.tools.studies.paper import TABLES, PaperScene, TableName
from desplat_ns.tools.studies.reproduce import (
    Smoke,
    find_contents,
    find_scenes,
    outputs_of,
)
from lab.reproduce.data_sets import (
    DISTORTION,
    SPLITS,
    write_data_sets,
)

pytestmark = [pytest.mark.usefixtures("tyro_may_build"), pytest.mark.slow]

SMOKE = Smoke(steps=4, side=48)

CLUTTER = {f"IMG_{number:04d}.JPG" for number in (3, 4, 5, 6, 7)}
EXTRA = {"IMG_0000.JPG", "IMG_0002.JPG"}
"""Of On-the-go: number 1 has no pose, and 8 is in no list."""


@pytest.fixture(scope="module")
def data_sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    write_data_sets(folder)
    return folder


def read(scene: PaperScene) -> str:
    return content_of(outputs_of(scene, "train"), outputs_of(scene, "test"))


def found_in(table: TableName, data: Path) -> dict[str, PaperScene]:
    return {scene.name: scene for scene in find_scenes(TABLES[table], data)[0]}


def names(outputs: DataparserOutputs) -> set[str]:
    return {path.name for path in outputs.image_filenames}


@pytest.mark.parametrize("table", ["robustnerf", "on-the-go", "A5", "A6"])
def test_every_scene_of_a_table_is_found_and_read(data_sets: Path, table: TableName):
    contents, missing = find_contents(TABLES[table], data_sets, SMOKE)
    assert not missing and len(contents) == len(TABLES[table].scenes)
    for content in contents.values():
        assert "48 x 32" in content


def test_robustnerf_is_told_apart_by_prefixes_and_read_from_its_small_copies(data_sets: Path):
    crab = found_in("robustnerf", data_sets)["Crab (1)"]
    outputs, tested = outputs_of(crab, "train"), outputs_of(crab, "test")
    assert names(outputs) == {f"2clutter00{n}.png" for n in range(1, 7)}
    assert names(tested) == {"1extra001.png", "1extra002.png"}
    assert all(path.parent.name == "images_8" for path in outputs.image_filenames)
    distortion = outputs.cameras.distortion_params
    assert distortion is not None
    k1, k2, _, _, p1, p2 = distortion[0].tolist()
    assert (k1, k2, p1, p2) == pytest.approx(DISTORTION, rel=1e-6)


def test_on_the_go_counts_the_photos_of_transforms_json_by_name(data_sets: Path):
    scenes = found_in("on-the-go", data_sets)
    outputs = outputs_of(scenes["Mountain"], "train")
    assert names(outputs) == CLUTTER and names(outputs_of(scenes["Mountain"], "test")) == EXTRA
    assert all(path.parent.name == "images" for path in outputs.image_filenames), "no copies"
    assert read(scenes["Mountain"]).endswith(" 0 points"), "the archive has none"
    assert "48 x " in read(scenes["Mountain"]), "8 times smaller"
    assert "96 x " in read(scenes["Patio"]), "4 times smaller"


@pytest.mark.parametrize("folder", SPLITS)
def test_photo_tourism_is_split_by_nerf_ws_file_whose_ids_have_points(data_sets, folder):
    scenes = found_in("A5", data_sets).values()
    (scene,) = (s for s in scenes if s.folder == folder)
    assert read(scene).startswith("6 photos train, 2 test")
    files = SOURCES[scene.fetch].files
    assert any(address.endswith(f"/{SPLITS[folder]}.tsv") for address in files)


def test_every_eighth_photo_of_mipnerf360_tests_by_colmaps_number(data_sets: Path):
    """The generated model has the last name first."""
    scenes = found_in("A6", data_sets)
    held_out = outputs_of(scenes["garden"], "test").image_filenames
    assert [f"{path.parent.name}/{path.name}" for path in held_out] == ["images_4/DSC07963.JPG"]
    assert "192 x " in read(scenes["kitchen"]), "rooms are 2 times smaller"
