"""What `desplat` is compared with."""

from __future__ import annotations

from typing import Any

import torch

from desplat_ns.studies.reproduce.baselines import (
    TRIMMED_SHARE,
    _trimmed,
    by_residual,
    by_truth,
)


def test_both_train_the_static_scene_alone():
    for method, truth in ((by_truth, True), (by_residual, False)):
        model: Any = method.config.pipeline.model
        assert model.by_truth is truth
        assert not model.effects.distractors


def test_a_trimmed_loss_leaves_out_the_largest_residuals():
    rendered, photo = torch.zeros(20, 20, 3), torch.rand(20, 20, 3) * 0.1
    photo[5:12, 5:12] = 1.0
    left_out = _trimmed(rendered, photo)[..., 0]
    assert left_out[6:11, 6:11].all()
    assert left_out.float().mean() < 1 - TRIMMED_SHARE
