"""nerfstudio's own commands on a tiny generated scene: trained once, then used in every way."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from nerfstudio.scripts import train
from nerfstudio.scripts.eval import ComputePSNR
from nerfstudio.scripts.render import DatasetRender
from nerfstudio.utils import writer
from plyfile import PlyData

from desplat_ns.backend import resolve
from desplat_ns.data.images import read_image

NUM_TRAIN, NUM_TEST, SIZE = 6, 2, (48, 32)
OUTPUTS = {"rgb", "rgb_static", "rgb_composite", "rgb_distractor", "alpha_distractor"}
OUTPUTS |= {"distractor_mask", "depth", "accumulation", "background"}


@pytest.fixture(scope="module")
def checkpoint(trained: Path) -> dict[str, Any]:
    """What the run saved, read as torch reads untrusted files."""
    (path,) = (trained.parent / "nerfstudio_models").glob("*.ckpt")
    return torch.load(path, map_location="cpu", weights_only=True)


def test_ns_eval_writes_every_figure(trained: Path, tmp_path: Path, checkpoint: dict):
    output = tmp_path / "metrics.json"
    ComputePSNR(trained, output, render_output_path=tmp_path / "pictures").main()
    results = json.loads(output.read_text(), parse_constant=pytest.fail)["results"]
    means = checkpoint["pipeline"]["_model.gauss_params.means"]
    assert results["num_static_gaussians"] == len(means)
    assert results["num_distractor_gaussians"] > 0
    assert results["num_images"] == NUM_TEST
    assert 5 < results["psnr"] < 60
    assert math.isfinite(results["psnr_std"])
    assert 0 <= results["mask_iou"] <= 1
    assert 0 <= results["alpha_outside_masks"] <= 1
    assert results["num_masks"] == NUM_TRAIN
    assert results["backend"] == resolve("auto").name
    assert ("lpips" in results) != ("lpips_reason" in results)
    assert {"desplat_ns", "nerfstudio", "gsplat", "torch"} <= results["versions"].keys()
    assert [image["width"] for image in results["images"]] == [SIZE[0]] * NUM_TEST
    assert len(list((tmp_path / "pictures").glob("*.png"))) == NUM_TEST


def test_a_run_is_evaluated_in_another_folder_than_it_was_trained_in(
    tiny_run, tiny_scene, tmp_path: Path, monkeypatch
):
    shutil.copytree(tiny_scene.folder, tmp_path / "capture")
    monkeypatch.chdir(tmp_path)
    config = tiny_run(Path("outputs"))
    config.pipeline.datamanager.dataparser.data = Path("capture")
    config.max_num_iterations = 2
    train.main(config)
    for one in writer.EVENT_WRITERS:  # as at the end of a command
        if isinstance(one, writer.TensorboardWriter):
            one.tb_writer.close()
    run = tmp_path / "outputs" / "tiny" / "desplat" / "run"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    ComputePSNR(run / "config.yml", Path("there.json")).main()
    new = tmp_path / "elsewhere"
    for name in ("outputs", "capture"):  # the run and its capture, moved together
        (tmp_path / name).rename(new / name)
    ComputePSNR(new / run.relative_to(tmp_path) / "config.yml", Path("moved.json")).main()
    there, moved = (json.loads(Path(f"{name}.json").read_text()) for name in ("there", "moved"))
    assert there["results"]["psnr"] == moved["results"]["psnr"]


def test_a_run_from_a_gpu_machine_is_evaluated_without_one(trained: Path, tmp_path: Path):
    config = yaml.load(trained.read_text(), Loader=yaml.UnsafeLoader)
    config.machine.device_type = "cuda"
    config.pipeline.model.backend = "gsplat"
    there = tmp_path / "config.yml"
    there.write_text(yaml.dump(config))
    ComputePSNR(there, tmp_path / "metrics.json").main()
    results = json.loads((tmp_path / "metrics.json").read_text())["results"]
    assert results["device"] == "cpu"
    assert results["backend"] in ("numba", "torch")


def test_every_output_of_both_splits_is_rendered(trained: Path, tmp_path: Path):
    DatasetRender(trained, output_path=tmp_path, split="train+test", image_format="png").main()
    for split, count in (("train", NUM_TRAIN), ("test", NUM_TEST)):
        folder = tmp_path / split
        assert {path.name for path in folder.iterdir()} == OUTPUTS | {"gt-rgb"}
        for name in OUTPUTS:
            pictures = [read_image(path) for path in sorted((folder / name).iterdir())]
            assert [p.shape for p in pictures] == [(SIZE[1], SIZE[0], 3)] * count
        for path in (folder / "rgb").iterdir():
            assert (read_image(path) == read_image(folder / "rgb_static" / path.name)).all()
    shown = {
        split: [read_image(path).any() for path in (tmp_path / split / "rgb_distractor").iterdir()]
        for split in ("train", "test")
    }
    assert all(shown["train"])
    assert not any(shown["test"])


def test_the_exported_splat_holds_the_static_gaussians_alone(
    trained: Path, tmp_path: Path, checkpoint: dict
):
    pytest.importorskip("open3d", exc_type=ImportError)  # its wheels may lack system libraries
    from nerfstudio.scripts.exporter import ExportGaussianSplat

    ExportGaussianSplat(trained, tmp_path).main()
    vertices = PlyData.read(tmp_path / "splat.ply")["vertex"].data
    saved = {
        key.rpartition(".")[2]: value.numpy()
        for key, value in checkpoint["pipeline"].items()
        if ".gauss_params." in key
    }
    visible = saved["opacities"][:, 0] >= -5.5373  # logit(1/255), where upstream draws the line
    assert len(vertices) == visible.sum() > 0
    for columns, name in (("xyz", "means"), (["f_dc_0", "f_dc_1", "f_dc_2"], "features_dc")):
        exported = np.stack([vertices[column] for column in columns], axis=-1)
        assert np.array_equal(exported, saved[name][visible])
