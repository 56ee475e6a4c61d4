"""nerfstudio's own commands on a tiny generated scene: trained once, then used in every way."""

import json
import math
import shutil
from pathlib import Path

import pytest
import yaml
from nerfstudio.scripts import train
from nerfstudio.scripts.eval import ComputePSNR
from nerfstudio.scripts.render import DatasetRender
from nerfstudio.utils import writer

from desplat_ns.backend import resolve
from desplat_ns.core.checkpoint import load_newest
from desplat_ns.data.images import read_image

NUM_TRAIN, NUM_TEST, SIZE = 6, 2, (48, 32)
OUTPUTS = {"rgb", "rgb_static", "rgb_composite", "rgb_distractor", "alpha_distractor"}
OUTPUTS |= {"distractor_mask", "depth", "accumulation", "background"}


def test_ns_eval_writes_every_figure(trained: Path, tmp_path: Path):
    output = tmp_path / "metrics.json"
    ComputePSNR(trained, output, render_output_path=tmp_path / "pictures").main()
    results = json.loads(output.read_text(), parse_constant=pytest.fail)["results"]
    state = load_newest(trained.parent / "nerfstudio_models")[1]
    assert results["num_static_gaussians"] == len(state["pipeline"]["_model.gauss_params.means"])
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
