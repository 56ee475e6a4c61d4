"""`on-the-go-data`: positions in split.json choose the photos, whatever gives the poses."""

import json
from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.on_the_go import OnTheGoDataParserConfig, ordered_names
from tests.helpers.files import write_transforms

NAMES = ("2clutter_b.png", "1extra_a.png", "2clutter_a.png", "0clean_a.png")
SPLIT = {"clean": [0], "extra": [1], "clutter": [2, 3]}
"""Positions among the sorted names."""


@pytest.fixture(params=["model", "transforms", "both"])
def scene(request: pytest.FixtureRequest, capture) -> Path:
    data = capture(NAMES)
    if request.param != "model":
        write_transforms(data, NAMES)
    if request.param == "transforms":
        (data / "sparse").rename(data / "other")
    (data / "split.json").write_text(json.dumps(SPLIT))
    return data


def outputs_of(data: Path, split: str, **options):
    return OnTheGoDataParserConfig(data=data, **options).setup().get_dataparser_outputs(split)


def names_of(data: Path, split: str, **options) -> set[str]:
    return {path.name for path in outputs_of(data, split, **options).image_filenames}


def test_clutter_trains_and_extras_are_held_out(scene: Path):
    assert names_of(scene, "train") == {"2clutter_a.png", "2clutter_b.png"}
    assert names_of(scene, "test") == names_of(scene, "val") == {"1extra_a.png"}


def test_every_photo_keeps_its_own_camera(scene: Path):
    """Photo i of `NAMES` stands at x = i, or at x = -i in COLMAP's capture (its pose is that of
    the world)."""
    plain = {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False}
    outputs = outputs_of(scene, "train", **plain)
    names = [path.name for path in outputs.image_filenames]
    places = outputs.cameras.camera_to_worlds[:, :, 3].norm(dim=1)
    assert places.tolist() == pytest.approx([NAMES.index(name) for name in names])


def test_a_listed_photo_without_a_pose_is_left_out_and_said(capture, capsys):
    data = capture(NAMES[:3])
    write_transforms(data, NAMES)
    (data / "split.json").write_text(json.dumps({"clutter": [2, 3, 0], "extra": [1]}))
    assert names_of(data, "train") == {"2clutter_a.png", "2clutter_b.png"}
    assert "1 of 3 photos that" in capsys.readouterr().out


@pytest.mark.parametrize(
    "content",
    [
        None,
        "{",
        '["clutter"]',
        '{"clutter": [0]}',
        '{"clutter": ["a"], "extra": [1]}',
        '{"clutter": [0, 4], "extra": [1]}',
        '{"clutter": [-1], "extra": [1]}',
        '{"clutter": [], "extra": [1]}',
    ],
)
def test_a_wrong_split_file_is_an_error_that_names_it(capture, content: str | None):
    data = capture(NAMES)
    if content is not None:
        (data / "split.json").write_text(content)
    with pytest.raises(CaptureError, match=r"split\.json"):
        outputs_of(data, "train")


def test_no_photo_with_a_pose_is_an_error(capture):
    data = write_transforms(capture(["a.png", "b.png"]), NAMES)
    (data / "split.json").write_text(json.dumps(SPLIT))
    with pytest.raises(CaptureError, match=r"a\.png, b\.png.*split\.json"):
        outputs_of(data, "train")


def test_positions_count_the_photos_of_transforms_json_before_those_of_the_folder(capture):
    data = capture(["z.png", "a.png"])
    assert ordered_names(data, Path("images")) == ["a.png", "z.png"]
    write_transforms(data, NAMES)
    assert ordered_names(data, Path("images")) == sorted(NAMES)
    (data / "transforms.json").write_text('{"frames": [3]}')
    with pytest.raises(CaptureError, match=r"transforms\.json"):
        ordered_names(data, Path("images"))
