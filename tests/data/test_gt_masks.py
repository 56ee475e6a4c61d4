"""Ground-truth masks are read at the size of the rendering, or named."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from desplat_ns.data.gt_masks import read_gt_mask

WIDTH, HEIGHT = 4, 2


def test_a_mask_is_reduced_to_the_size_of_the_rendering(tmp_path: Path):
    large = np.zeros((3 * HEIGHT, 3 * WIDTH), np.uint8)
    large[:, :3] = 255
    Image.fromarray(large).save(tmp_path / "big.png")
    mask = read_gt_mask(tmp_path / "big.png", WIDTH, HEIGHT)
    assert mask.shape == (HEIGHT, WIDTH, 1)
    assert torch.equal(mask[..., 0], torch.tensor([[True, False, False, False]] * HEIGHT))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_in_a_mask_of_0_and_1_what_is_1_counts(tmp_path: Path, kind: type):
    Image.fromarray(np.array([[0, 1, 1, 0]] * HEIGHT, kind)).save(tmp_path / "a.png")
    mask = read_gt_mask(tmp_path / "a.png", WIDTH, HEIGHT)
    assert torch.equal(mask[..., 0], torch.tensor([[False, True, True, False]] * HEIGHT))
