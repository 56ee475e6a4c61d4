"""Which training view a camera is, and how photos are called."""

from pathlib import Path

import torch

from desplat_ns.data.training_views import image_names, train_index
from tests.helpers.cameras import cameras


def test_only_train_idx_says_which_training_view_a_camera_is():
    assert train_index(cameras()) is None
    assert train_index(cameras(metadata={"cam_idx": 3})) is None
    assert train_index(cameras(metadata={"train_idx": torch.tensor([[7]])})) == 7
    both = {"train_idx": torch.tensor([[7]]), "cam_idx": 7}
    assert train_index(cameras(metadata=both)) == 7


def test_names_are_relative_to_the_folder_that_all_photos_share():
    paths = [Path("/c/images/left/1.png"), Path("/c/images/right/1.png")]
    assert image_names(paths) == ["left/1.png", "right/1.png"]
    assert image_names([Path("/c/images/1.png")]) == ["1.png"]
    assert image_names([]) == []
