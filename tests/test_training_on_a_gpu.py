"""`desplat` as registered trains on a CUDA device; test_fake_cuda.py does what it can without."""

from pathlib import Path

import pytest
import torch

from desplat_ns.core.checkpoint import checkpoint_path, load_checkpoint
from lab.synthetic import write_scene
from tests.helpers.registered import EIGHT_VIEWS, STEPS, registered_desplat, set_up

pytestmark = [pytest.mark.gpu, pytest.mark.slow]


def test_desplat_trains_on_a_gpu_places_distractors_and_writes_its_checkpoint(tmp_path: Path):
    config = registered_desplat(write_scene(EIGHT_VIEWS, tmp_path / "scene"), tmp_path)
    config.machine.device_type = "cuda"
    trainer = set_up(config)
    model = trainer.pipeline.model
    trainer.train()
    assert all(parameter.is_cuda for parameter in model.parameters())
    assert model.rasterizer.name == "gsplat"
    assert trainer.optimizers.skipped_in_a_row == 0
    assert model.num_points > 300 and all(model.distractors.counts())
    state = load_checkpoint(checkpoint_path(config.get_checkpoint_dir(), STEPS - 1))
    saved = [value for value in state["pipeline"].values() if isinstance(value, torch.Tensor)]
    assert saved and all(bool(value.isfinite().all()) for value in saved)
