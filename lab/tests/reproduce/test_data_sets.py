"""Data sets are read as they lie on the disk: names, camera models, and what COLMAP left out."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.fetch.sources import SOURCES
from desplat_ns.tools.studies.methods import content_of
from desplat_ns.tools.studies.paper import TABLES, PaperScene, TableName
from desplat_ns.tools.studies.reproduce import (
    Smoke,
    find_contents,
    find_scenes,
    outputs_of,
    smaller,
)
from lab.reproduce.data_sets import (
    DISTORTION,
    SPLITS,
    TINY,
    write_converted_on_the_go,
    write_data_sets,
    write_undistorted_on_the_go,
)
from lab.synthetic import Scene, make_scene

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


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(TINY)


@pytest.fixture
def spot(data_sets: Path, tmp_path: Path) -> Path:
    """A scene of On-the-go that a test may spoil."""
    return shutil.copytree(data_sets / "on-the-go" / "spot", tmp_path / "on-the-go" / "spot")


def read(scene: PaperScene) -> str:
    return content_of(outputs_of(scene, "train"), outputs_of(scene, "test"))


def found_in(table: TableName, data: Path) -> dict[str, PaperScene]:
    return {scene.name: scene for scene in find_scenes(TABLES[table], data)[0]}


def names(outputs: DataparserOutputs) -> set[str]:
    return {path.name for path in outputs.image_filenames}


@pytest.mark.parametrize("table", ["robustnerf", "on-the-go", "A5", "A6", "fig9"])
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


def test_clean_and_cluttered_photos_of_a_number_are_twins(data_sets: Path):
    scenes = found_in("fig9", data_sets)
    for percent, number in ((0, 0), (25, 2), (75, 4), (100, 6)):  # round(6 / 4), to even
        outputs = outputs_of(smaller(scenes[f"Crab (2), {percent}% cluttered"], 48), "train")
        kinds = [name.removesuffix(".png") for name in names(outputs)]
        assert sum("clutter" in kind for kind in kinds) == number
        assert {kind[-3:] for kind in kinds} == {f"00{n}" for n in range(1, 7)}, "each viewpoint"


def test_on_the_go_counts_the_photos_of_transforms_json_by_name(data_sets: Path):
    scenes = found_in("on-the-go", data_sets)
    outputs = outputs_of(scenes["Mountain"], "train")
    assert names(outputs) == CLUTTER and names(outputs_of(scenes["Mountain"], "test")) == EXTRA
    assert all(path.parent.name == "images" for path in outputs.image_filenames), "no copies"
    assert read(scenes["Mountain"]).endswith(" 0 points"), "the archive has none"
    assert "48 x " in read(scenes["Mountain"]), "8 times smaller"
    assert "96 x " in read(scenes["Patio"]), "4 times smaller"


@pytest.mark.parametrize("write", [write_converted_on_the_go, write_undistorted_on_the_go])
@pytest.mark.parametrize("folder", ["patio_high", "patio-high"])
def test_copies_of_on_the_go_with_a_colmap_model_have_the_same_split(
    scene: Scene, tmp_path: Path, write, folder: str
):
    write(scene, tmp_path / "on-the-go" / folder)
    patio = found_in("on-the-go", tmp_path)["Patio-High"]
    assert names(outputs_of(patio, "train")) == CLUTTER
    assert names(outputs_of(patio, "test")) == EXTRA
    assert len(outputs_of(patio, "train").metadata["points3D_xyz"]) > 100


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


def test_a_data_set_half_downloaded_is_refused_by_name(spot: Path, tmp_path: Path):
    for photo in sorted((spot / "images").iterdir())[::2]:
        photo.unlink()
    with pytest.raises(CaptureError, match=r"on-the-go, Spot: .*fetch the data set again"):
        read(found_in("on-the-go", tmp_path)["Spot"])


@pytest.mark.parametrize("absent", ["transforms.json", "split.json"])
def test_a_scene_without_one_of_its_files_is_refused_by_name(spot, tmp_path, absent: str):
    (spot / absent).unlink()
    with pytest.raises(CaptureError, match=rf"Spot: .*{absent}"):
        read(found_in("on-the-go", tmp_path)["Spot"])
