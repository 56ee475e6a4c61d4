"""Mask scores over training views, with a model whose distractors are known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from desplat_ns.data.training_views import train_index
from desplat_ns.data.true_masks import METADATA_KEY, read_mask
from nerfstudio.cameras.cameras import Cameras
from PIL import Image

from desplat_ns.errors import CaptureError
from desplat_ns.evaluation.mask_scores import score_masks

WIDTH, HEIGHT = 4, 2


class _Model:
    """View 0 covers its left half at 0.8; the others are empty but for a haze of 0.1."""

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, torch.Tensor]:
        alpha = torch.full((HEIGHT, WIDTH, 1), 0.1)
        if train_index(camera) == 0:
            alpha[:, : WIDTH // 2] = 0.8
        return {"alpha_distractor": alpha, "distractor_mask": alpha > 0.5}


def _manager(masks: list[Path | None], distortion: float = 0.0) -> SimpleNamespace:
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
    return SimpleNamespace(
        device="cpu",
        train_dataset=SimpleNamespace(cameras=cameras),
        train_dataparser_outputs=SimpleNamespace(metadata={METADATA_KEY: masks}),
    )


def _write(path: Path, columns: int, scale: int = 1) -> Path:
    """A mask whose first `columns` columns are white."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:, :columns] = 255
    Image.fromarray(mask.repeat(scale, 0).repeat(scale, 1)).save(path)
    return path


def test_iou_and_alpha_outside_are_means_over_the_views_with_masks(tmp_path: Path):
    masks = [_write(tmp_path / "0.png", 1), None, _write(tmp_path / "2.png", 1)]
    scores = score_masks(_Model(), _manager(masks))
    # View 0: 2 of 4 predicted pixels are right; outside lie 2 pixels of 0.8 and 4 of 0.1.
    # View 2: nothing predicted, 2 pixels missed; outside all is 0.1.
    assert scores["num_masks"] == 2
    assert scores["mask_iou"] == pytest.approx((0.5 + 0.0) / 2)
    assert scores["alpha_outside_masks"] == pytest.approx(((2 * 0.8 + 4 * 0.1) / 6 + 0.1) / 2)


def test_nothing_predicted_where_nothing_is_scores_1(tmp_path: Path):
    masks = [None, _write(tmp_path / "1.png", 0)]
    assert score_masks(_Model(), _manager(masks))["mask_iou"] == 1.0


def test_a_capture_without_masks_has_no_scores(tmp_path: Path):
    assert score_masks(_Model(), _manager([None, None])) == {}
    manager = _manager([None])
    manager.train_dataparser_outputs.metadata.clear()
    assert score_masks(_Model(), manager) == {}


def test_a_mask_over_everything_leaves_alpha_outside_undefined(tmp_path: Path):
    scores = score_masks(_Model(), _manager([_write(tmp_path / "0.png", WIDTH)]))
    assert "alpha_outside_masks" not in scores
    assert scores["mask_iou"] == pytest.approx(0.5)


def test_distorted_photos_are_left_out(tmp_path: Path):
    masks: list[Path | None] = [_write(tmp_path / "0.png", 1)]
    assert score_masks(_Model(), _manager(masks, distortion=0.1)) == {}


def test_a_mask_is_reduced_to_the_size_of_the_rendering(tmp_path: Path):
    mask = read_mask(_write(tmp_path / "big.png", 1, scale=3), WIDTH, HEIGHT)
    assert mask.shape == (HEIGHT, WIDTH, 1)
    assert torch.equal(mask[..., 0], torch.tensor([[True, False, False, False]] * HEIGHT))


@pytest.mark.parametrize("content", [None, b"not an image"])
def test_an_unreadable_mask_is_named(tmp_path: Path, content: bytes | None):
    path = tmp_path / "mask_0007.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaptureError, match=r"mask_0007\.png"):
        read_mask(path, WIDTH, HEIGHT)
