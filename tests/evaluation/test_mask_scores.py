"""Mask scores over training views, with a model whose distractors are known."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.data.training_views import train_index
from desplat_ns.evaluation.evaluate import score_masks
from tests.helpers.masks import HEIGHT, WIDTH, write_mask


def _draw(camera: Cameras) -> dict[str, torch.Tensor]:
    """View 0 covers its left half at 0.8; the others are empty but for a haze of 0.1."""
    alpha = torch.full((HEIGHT, WIDTH, 1), 0.1)
    if train_index(camera) == 0:
        alpha[:, : WIDTH // 2] = 0.8
    return {"alpha_distractor": alpha, "distractor_mask": alpha > 0.5}


def _views(masks: list[Path | None], distortion: float = 0.0) -> list[tuple[Cameras, Path]]:
    """The training views that have masks."""
    n = len(masks)
    cameras = Cameras(
        camera_to_worlds=torch.eye(4)[None, :3].repeat(n, 1, 1),
        fx=4.0,
        fy=4.0,
        cx=2.0,
        cy=1.0,
        width=WIDTH,
        height=HEIGHT,
        distortion_params=torch.full((n, 6), distortion),
        metadata={"train_idx": torch.arange(n)[:, None]},
    )
    return [(cameras[i : i + 1], path) for i, path in enumerate(masks) if path is not None]


def test_a_mask_over_everything_leaves_alpha_outside_undefined(tmp_path: Path):
    scores = score_masks(_draw, _views([write_mask(tmp_path / "0.png", WIDTH)]))
    assert "alpha_outside_masks" not in scores
    assert scores["mask_iou"] == pytest.approx(0.5)


def test_distorted_photos_and_captures_without_masks_have_no_scores(tmp_path: Path):
    masks: list[Path | None] = [write_mask(tmp_path / "0.png", 1)]
    assert score_masks(_draw, _views(masks, distortion=0.1)) == {}
    assert score_masks(_draw, _views([None, None])) == {}
