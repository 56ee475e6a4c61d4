"""nerfstudio's commands on a small generated Photo Tourism scene, trained once."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from nerfstudio.scripts import train
from nerfstudio.scripts.eval import ComputePSNR
from nerfstudio.utils.eval_utils import eval_setup

from desplat_ns.cameras.views import view_of
from desplat_ns.core.errors import ConfigError
from desplat_ns.data.photo_tourism import PhotoTourismDataParserConfig
from desplat_ns.photo_tourism.shown_light import VARIABLE
from desplat_ns.tools.commands.evaluate import Evaluate
from lab.synthetic import SceneSpec, write_scene
from tests.helpers.registered import registered, set_up
from tests.helpers.splat_files import drawn, read_splats

pytestmark = pytest.mark.slow

STEPS, SIZES = 24, {(48, 32), (32, 48)}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """config.yml of `ns-train desplat-phototourism`, 24 steps; do not write beside it."""
    small = {"num_views": 5, "num_extras": 2, "width": 48, "height": 32, "num_points": 300}
    spec = replace(SceneSpec.tourism(), other_sizes=((32, 48),), **small)
    scene = write_scene(spec, tmp_path_factory.mktemp("tourism"))
    assert scene.folder is not None
    parser = PhotoTourismDataParserConfig(data=scene.folder)
    output, short = tmp_path_factory.mktemp("runs"), {"max_num_iterations": STEPS}
    short |= {"steps_per_eval_image": 10, "steps_per_eval_all_images": 20}
    config = registered("desplat-phototourism", parser, output, **short)
    config.pipeline.evaluation.steps = 5
    model = config.pipeline.model
    model.num_downscales, model.schedule_scale, model.distractors.per_view = 0, 0.02, 40
    train.main(config)
    return config.get_base_dir() / "config.yml"


def evaluate(run: Path, output: Path, **options: Any) -> dict[str, Any]:
    """Results of `desplat-eval`, the protocol's options given by name."""
    Evaluate(run, output_path=output, **options).main()
    return json.loads(output.read_text())["results"]


def test_plain_ns_eval_follows_the_protocol(run: Path, tmp_path: Path):
    output = tmp_path / "metrics.json"
    ComputePSNR(run, output, render_output_path=tmp_path / "pictures").main()
    results = json.loads(output.read_text(), parse_constant=pytest.fail)["results"]
    assert results["protocol"].startswith("right half")
    assert "5 steps of Adam at 0.01 on its left half" in results["protocol"]
    assert {"psnr", "psnr_before", "ssim", "ssim_before"} <= results.keys()
    assert results["psnr"] != results["psnr_before"]
    assert {(i["width"], i["height"]) for i in results["images"]} <= SIZES
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 2


def test_resuming_goes_on_with_every_group(run: Path, tmp_path: Path):
    config: Any = yaml.load(run.read_text(), Loader=yaml.UnsafeLoader)
    config.load_dir = run.parent / "nerfstudio_models"
    config.output_dir, config.max_num_iterations = tmp_path, STEPS + 2
    trainer = set_up(config)
    groups = {"image_embeddings", "appearance_mlp", "appearance_features", "background_sh_dc"}
    assert groups <= trainer.optimizers.optimizers.keys()
    before = {n: p.detach().clone() for n, p in trainer.pipeline.model.named_parameters()}
    trainer.train()
    moved = [n for n, p in trainer.pipeline.model.named_parameters() if "image_effects" in n]
    after = dict(trainer.pipeline.model.named_parameters())
    heads = [n for n in moved if not n.endswith("encoder.0.weight")]  # dead units may stay
    assert heads and all(not torch.equal(after[n], before[n]) for n in heads)


def test_the_exported_splat_wears_the_chosen_appearance(run: Path, tmp_path: Path, monkeypatch):
    """The PLY, rendered, is the image that the model draws in that light."""
    pytest.importorskip("open3d", exc_type=ImportError)  # its wheels may lack system libraries
    from nerfstudio.scripts.exporter import ExportGaussianSplat

    monkeypatch.setenv(VARIABLE, "photo_0003.png")
    ExportGaussianSplat(run, tmp_path).main()
    pipeline: Any = eval_setup(run, test_mode="test")[1]
    model: Any = pipeline.model
    camera, _ = pipeline.datamanager.fixed_indices_eval_dataloader[0]
    outputs = model.get_outputs_for_camera(camera)
    behind = (1 - outputs["accumulation"]) * outputs["background"]  # not in any file
    exported = read_splats((tmp_path / "splat.ply").read_bytes(), "ply")
    shown = (drawn(exported, view_of(camera)) + behind.numpy()).clip(0, 1)
    np.testing.assert_allclose(shown, outputs["rgb"].numpy(), rtol=0, atol=2e-3)
    monkeypatch.delenv(VARIABLE)
    ExportGaussianSplat(run, tmp_path / "mean").main()
    mean = read_splats((tmp_path / "mean" / "splat.ply").read_bytes(), "ply")
    assert np.abs(mean.harmonics[:, 0] - exported.harmonics[:, 0]).max() > 1e-6


def test_what_is_there_is_replaced_only_if_that_is_asked_for(run: Path, tmp_path: Path):
    figures, pictures, other = tmp_path / "m.json", tmp_path / "pictures", tmp_path / "o.json"
    figures.write_text("before")
    pictures.mkdir()
    (pictures / "mine.png").touch()
    for given in (
        Evaluate(run, output_path=figures),
        Evaluate(run, output_path=other, render_output_path=pictures),
    ):
        with pytest.raises(ConfigError, match="--overwrite"):
            given.main()
    assert figures.read_text() == "before"
    Evaluate(run, output_path=figures, render_output_path=pictures, overwrite=True).main()
    assert figures.read_text() != "before" and len(list(pictures.iterdir())) == 3
