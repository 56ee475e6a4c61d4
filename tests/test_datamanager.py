"""Training cameras carry their number, held-out ones none; CUDA is never needed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
import pytest
import torch
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
from nerfstudio.data.dataparsers.phototourism_dataparser import PhototourismDataParserConfig

from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.datamanager import DeSplatDataManager, DeSplatDataManagerConfig, without_prompts
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.photo_tourism.dataparser import PhotoTourismDataParserConfig
from tests.helpers.lenses import distort


def manager(dataparser, test_mode: str = "val", **options) -> DeSplatDataManager:
    config = DeSplatDataManagerConfig(dataparser=dataparser, **options)
    return config.setup(device="cpu", test_mode=test_mode)


@pytest.fixture
def copy(tiny_scene, tmp_path: Path) -> Path:
    """The tiny scene (6 clean, 6 clutter, 2 extra) in a folder that may be changed."""
    return Path(shutil.copytree(tiny_scene.folder, tmp_path / "scene"))


def shifted(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


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
def test_points_of_one_colour_start_in_those_of_the_photos(copy: Path, capsys, color: int):
    def colors(**options) -> torch.Tensor:
        data = manager(RobustNerfDataParserConfig(data=copy), **options)
        return data.train_dataparser_outputs.metadata["points3D_rgb"]

    own = colors()
    assert "points have no colours" not in capsys.readouterr().out
    points = copy / "sparse" / "0" / "points3D.txt"
    model = pycolmap.Reconstruction(copy / "sparse" / "0")
    for point in model.points3D.values():
        point.color = np.full(3, color, np.uint8)
    model.write_binary(points.parent)
    for file in points.parent.glob("*.txt"):
        file.unlink()
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


def test_a_restored_sampler_goes_on_in_the_same_order(tiny_scene, tmp_path: Path):
    parser = ColmapDataParserConfig(data=tiny_scene.folder)
    first = manager(parser)
    for step in range(4):
        first.next_train(step)
    torch.save(first.sampler_state(), tmp_path / "state.pt")
    expected = [first.next_train(step)[1]["image_idx"] for step in range(20)]
    other = manager(parser, train_cameras_sampling_seed=7)
    other.load_sampler_state(torch.load(tmp_path / "state.pt", weights_only=True))
    assert [other.next_train(step)[1]["image_idx"] for step in range(20)] == expected


def test_one_training_photo_is_an_error(copy: Path):
    (copy / "train_list.txt").write_text(next((copy / "images").glob("clutter_*")).name)
    (copy / "test_list.txt").write_text(next((copy / "images").glob("extra_*")).name)
    with pytest.raises(CaptureError, match="has 1 training photos; two or more"):
        manager(DeSplatColmapDataParserConfig(data=copy))


def test_no_evaluation_photo_is_an_error(copy: Path):
    images = sorted((copy / "images").iterdir())
    frames = [
        {"file_path": f"images/{path.name}", "transform_matrix": shifted(float(i)).tolist()}
        for i, path in enumerate(images)
    ]
    meta = {"fl_x": 50, "fl_y": 50, "cx": 24, "cy": 16, "w": 48, "h": 32, "frames": frames}
    (copy / "transforms.json").write_text(json.dumps(meta))
    with pytest.raises(CaptureError, match="--eval-mode"):
        manager(NerfstudioDataParserConfig(data=copy, train_split_fraction=1.0))


def test_distorted_photos_are_undistorted_as_upstream(copy: Path):
    plain = manager(RobustNerfDataParserConfig(data=copy)).next_train(0)[1]
    distort(copy)
    data = manager(RobustNerfDataParserConfig(data=copy))
    batch = data.next_train(0)[1]
    index = batch["image_idx"]
    assert index == plain["image_idx"]
    height, width, _ = batch["image"].shape
    camera = data.train_dataset.cameras[index]
    assert (camera.width.item(), camera.height.item()) == (width, height)  # cropped by upstream
    assert not torch.equal(batch["image"], plain["image"][:height, :width])
    torch.testing.assert_close(data.train_dataset.get_data(index, "uint8")["image"], plain["image"])
