from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from desplat_ns.data.images import read_image, read_mask
from lab.separation.small_movers import scored
from lab.separation.small_things import HELD_OUT_EVERY, KINDS, Wish, figure, make, over, wishes
from lab.synthetic import SceneSpec, write_scene

SPEC = replace(SceneSpec.tiny(), num_views=14, width=120, height=160)
"""Sixteen photos of which the first and the ninth are held out."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A generated scene, and what was made of it twice."""
    scene, made = tmp_path_factory.mktemp("scene"), tmp_path_factory.mktemp("made")
    write_scene(SPEC, scene)
    for name in ("first", "second"):
        make(scene, scene, made / name, seed=1)
    return scene, made / "first", made / "second"


def _contents(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_the_same_seed_gives_the_same_bytes(folders):
    _, first, second = folders
    assert _contents(first) == _contents(second)


def test_held_out_photos_and_photos_without_a_thing_are_the_scene_s_own(folders):
    scene, first, _ = folders
    names = sorted(path.name for path in (first / "images").iterdir())
    things = json.loads((first / "things.json").read_text())
    shown = {name for thing in things for name in thing["boxes"]}
    assert shown and shown.isdisjoint(names[::HELD_OUT_EVERY])
    for name in set(names) - shown:
        assert (first / "images" / name).read_bytes() == (scene / "images" / name).read_bytes()


def test_a_mask_has_the_asked_area_and_a_photo_differs_in_it_alone(folders):
    _, first, _ = folders
    for thing in json.loads((first / "things.json").read_text()):
        for name, (left, top, right, bottom) in thing["boxes"].items():
            mask = read_mask((first / "masks" / name).with_suffix(".png"))
            asked = thing["size"] * (0.5 if thing["kind"] == "far" else 1.0)
            share = mask[top:bottom, left:right].sum() / mask.size
            assert 1 / 1.5 < share / asked < 1.5
            photo, clean = (read_image(first / f / name) for f in ("images", "clean"))
            around = np.pad(mask, 8)
            near = np.lib.stride_tricks.sliding_window_view(around, (17, 17)).any(axis=(2, 3))
            assert (photo == clean)[~near].all()


def test_a_thing_that_is_cut_shows_its_half():
    layer = np.repeat(figure(400.0)[..., None], 4, axis=-1)
    _, alpha = over(np.zeros((60, 60, 3), np.float32), layer, 0, 30)
    assert alpha.sum() == pytest.approx(200, rel=0.1)


def test_all_kinds_come_before_one_comes_twice():
    chosen = [wish.kind for wish in wishes(11, np.random.default_rng(0)) if wish.kind != "plain"]
    assert sorted(chosen) == sorted(KINDS)
    assert len({*wishes(36, np.random.default_rng(0))}) == 36
    assert Wish("plain", 0.06, 3) in wishes(28, np.random.default_rng(0))


def test_things_are_found_where_the_mask_is_theirs(folders, tmp_path):
    """By a pipeline that masks the true masks, and whose static scene is the clean photo."""
    _, first, _ = folders
    names = sorted(path.name for path in (first / "clean").iterdir())
    photos = [torch.from_numpy(read_image(first / "images" / name)[..., :3]) for name in names]

    def outputs(camera: torch.Tensor) -> dict[str, torch.Tensor]:
        name = names[int(camera[0])]
        mask = torch.from_numpy(read_mask((first / "masks" / name).with_suffix(".png")))
        clean = torch.from_numpy(read_image(first / "clean" / name)[..., :3] / np.float32(255))
        return {"distractor_mask": mask[..., None], "rgb_static": clean}

    class Dataset(list):
        cameras = torch.arange(len(names))

    dataset = Dataset({"image": photo} for photo in photos)
    manager = SimpleNamespace(train_dataset=dataset, train_image_names=names)
    pipeline = SimpleNamespace(datamanager=manager, device="cpu", eval=lambda: None)
    pipeline.model = SimpleNamespace(get_outputs=outputs)
    result = scored(pipeline, first, tmp_path)
    assert result["false"] == 0 and result["sights"]
    for sight in result["sights"]:
        assert sight["iou"] == 1 and sight["ghost"] == pytest.approx(0, abs=1e-5)
    assert len(list(tmp_path.iterdir())) == len(names)
