"""Training cameras carry their number, held-out ones none; CUDA is never needed."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import torch
from nerfstudio.data.dataparsers.blender_dataparser import BlenderDataParserConfig
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
from nerfstudio.data.dataparsers.phototourism_dataparser import PhototourismDataParserConfig

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.layouts import without_prompts
from desplat_ns.data.on_the_go import OnTheGoDataParserConfig
from desplat_ns.data.photo_tourism import PhotoTourismDataParserConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.training.datamanager import DeSplatDataManager, DeSplatDataManagerConfig
from tests.helpers.files import posed, write_transforms
from tests.helpers.lenses import distort


def manager(dataparser, test_mode: str = "val", **options) -> DeSplatDataManager:
    config = DeSplatDataManagerConfig(dataparser=dataparser, **options)
    return config.setup(device="cpu", test_mode=test_mode)


def test_training_cameras_say_which_view_they_are(tiny_scene):
    data = manager(RobustNerfDataParserConfig(data=tiny_scene.folder))
    indices = set()
    for step in range(6):
        camera, batch = data.next_train(step)
        assert camera.metadata is not None
        assert camera.metadata["train_idx"].tolist() == [[batch["image_idx"]]]
        assert batch["image"].dtype == torch.uint8
        indices.add(batch["image_idx"])
    assert indices == set(range(6))
    held_out = [camera for camera, _ in data.fixed_indices_eval_dataloader]
    held_out.append(data.next_eval(0)[0])
    assert all("train_idx" not in (camera.metadata or {}) for camera in held_out)


@pytest.mark.parametrize("color", [0, 255])
def test_points_of_one_colour_start_in_those_of_the_photos(tiny_copy: Path, capsys, color: int):
    def colors(**options) -> torch.Tensor:
        data = manager(RobustNerfDataParserConfig(data=tiny_copy), **options)
        return data.train_dataparser_outputs.metadata["points3D_rgb"]

    own = colors()
    assert "points have no colours" not in capsys.readouterr().out
    model = pycolmap.Reconstruction(tiny_copy / "sparse" / "0")
    for point in model.points3D.values():
        point.color = np.full(3, color, np.uint8)
    model.write_binary(tiny_copy / "sparse" / "0")
    off = (colors().float() - own.float()).abs().mean(dim=1).median()
    assert off < 40 and "points have no colours" in capsys.readouterr().out
    assert (colors(test_mode="test") == color).all(), "what was trained needs them no more"


def test_on_the_cpu_nothing_is_pinned(tiny_scene, monkeypatch):
    def fail(self):
        raise RuntimeError("pinned")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.Tensor, "pin_memory", fail)
    data = manager(RobustNerfDataParserConfig(data=tiny_scene.folder), cache_images="cpu")
    assert data.next_train(0)[1]["image"].device.type == "cpu"


def test_upstreams_parsers_are_swapped_where_they_would_ask_or_refused_with_the_name_of_ours(
    tiny_scene,
):
    data = manager(ColmapDataParserConfig(data=tiny_scene.folder))
    assert type(data.config.dataparser) is DeSplatColmapDataParserConfig
    assert isinstance(data.train_dataset, CaptureDataset)
    assert without_prompts(NerfstudioDataParserConfig())._target is TransformsDataParser
    with pytest.raises(ConfigError, match="photo-tourism-data"):
        without_prompts(PhototourismDataParserConfig())
    for own in (RobustNerfDataParserConfig(), PhotoTourismDataParserConfig()):
        assert without_prompts(own) is own


def test_one_training_photo_is_an_error(tiny_copy: Path):
    (tiny_copy / "train_list.txt").write_text(next((tiny_copy / "images").glob("clutter_*")).name)
    (tiny_copy / "test_list.txt").write_text(next((tiny_copy / "images").glob("extra_*")).name)
    with pytest.raises(CaptureError, match="has 1 training photos; two or more"):
        manager(DeSplatColmapDataParserConfig(data=tiny_copy))


def test_no_evaluation_photo_is_an_error(tiny_copy: Path):
    write_transforms(tiny_copy, sorted(os.listdir(tiny_copy / "images")), **LENS)
    with pytest.raises(CaptureError, match="--eval-mode"):
        manager(NerfstudioDataParserConfig(data=tiny_copy, train_split_fraction=1.0))


LENS = {"fl_x": 50, "fl_y": 50, "cx": 24, "cy": 16, "w": 48, "h": 32}
"""Of the tiny scene, as transforms.json has it."""


def held_out_and_trained(tiny_copy: Path, kind: str) -> Any:
    """A capture of which clutter_0001.png, or its bytes, is in both splits."""
    names = sorted(path.name for path in (tiny_copy / "images").glob("clutter_*"))
    extra = next((tiny_copy / "images").glob("extra_*"))
    if kind in ("lists", "test list only"):
        (tiny_copy / "train_list.txt").write_text("\n".join(names))
        (tiny_copy / "test_list.txt").write_text(f"{extra.name}\n{names[0]}")
        if kind == "test list only":
            (tiny_copy / "val_list.txt").write_text(extra.name)
        return DeSplatColmapDataParserConfig(data=tiny_copy)
    if kind in ("copy", "link"):
        extra.unlink()
        (shutil.copy if kind == "copy" else os.symlink)(tiny_copy / "images" / names[0], extra)
        return RobustNerfDataParserConfig(data=tiny_copy)
    if kind == "split.json":
        write_transforms(tiny_copy, names, **LENS)
        (tiny_copy / "split.json").write_text('{"clutter": [0, 1, 2, 3], "extra": [0]}')
        return OnTheGoDataParserConfig(data=tiny_copy, colmap_path=Path("none"))
    if kind == "transforms lists":
        lists = {"train_filenames": names, "test_filenames": [names[0]]}
        lists = {key: [f"./images/{name}" for name in value] for key, value in lists.items()}
        write_transforms(tiny_copy, names, **LENS, **lists, val_filenames=[f"images/{names[0]}"])
        return NerfstudioDataParserConfig(data=tiny_copy)
    if kind == "frame twice":
        write_transforms(tiny_copy, [*names, names[0]], **LENS)
        return NerfstudioDataParserConfig(data=tiny_copy, eval_mode="interval", eval_interval=7)
    for split, listed in (("train", names), ("val", [extra.name]), ("test", names[:1])):
        frames = [posed(f"images/{name[:-4]}", i) for i, name in enumerate(listed)]
        meta = json.dumps({"camera_angle_x": 0.9, "frames": frames})
        (tiny_copy / f"transforms_{split}.json").write_text(meta)
    return BlenderDataParserConfig(data=tiny_copy)


KINDS = ("lists", "test list only", "copy", "link", "split.json", "transforms lists", "frame twice")


@pytest.mark.parametrize("kind", [*KINDS, "blender"])
def test_photos_that_train_and_are_held_out_are_refused_whatever_lists_them(tiny_copy: Path, kind):
    parser = held_out_and_trained(tiny_copy, kind)
    with pytest.raises(CaptureError, match=r"1 of \d held-out .*clutter_0001\.png"):
        manager(parser)


def test_a_trained_run_and_one_that_is_asked_for_all_photos_are_warned(tiny_copy: Path, capsys):
    manager(held_out_and_trained(tiny_copy, "lists"), test_mode="test")
    assert "1 of 2 held-out photos" in capsys.readouterr().out
    (tiny_copy / "train_list.txt").unlink()
    (tiny_copy / "test_list.txt").unlink()
    manager(DeSplatColmapDataParserConfig(data=tiny_copy, eval_mode="all"))
    assert "14 of 14 held-out photos" in capsys.readouterr().out


def test_distorted_photos_are_undistorted_as_upstream(tiny_copy: Path):
    plain = manager(RobustNerfDataParserConfig(data=tiny_copy)).next_train(0)[1]
    distort(tiny_copy)
    data = manager(RobustNerfDataParserConfig(data=tiny_copy))
    batch = data.next_train(0)[1]
    index = batch["image_idx"]
    assert index == plain["image_idx"]
    height, width, _ = batch["image"].shape
    camera = data.train_dataset.cameras[index]
    assert (camera.width.item(), camera.height.item()) == (width, height)  # cropped by upstream
    assert not torch.equal(batch["image"], plain["image"][:height, :width])
    torch.testing.assert_close(data.train_dataset.get_data(index, "uint8")["image"], plain["image"])
