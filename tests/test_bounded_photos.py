"""Training where not all photos fit into memory: the same bits, and nothing trained is lost."""

import copy
import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.photo_cache import BoundedPhotos
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.training.datamanager import DeSplatDataManager, DeSplatDataManagerConfig
from lab.pictures import write_image
from tests.helpers.lenses import BARREL, distort
from tests.helpers.registered import last_state, set_up
from tests.helpers.stub_run import assert_same

THREE_PHOTOS = 2.4e-5
"""GB: photos of 48x32 pixels have 4,608 bytes; three of training fit beside the two held out, and
of those with masks, 6,144 bytes, one does."""


def manager(dataparser: Any, photo_memory: float | None = None) -> DeSplatDataManager:
    config = DeSplatDataManagerConfig(dataparser=dataparser, photo_memory=photo_memory)
    return config.setup(device="cpu", test_mode="val")


def mask_photos(data: Path) -> Path:
    """Masks of the photos, at random; their folder."""
    for seed, path in enumerate(sorted((data / "images").iterdir())):
        used = np.random.default_rng(seed).random((32, 48)) < 0.5
        write_image(data / "used" / f"{path.stem}.png", used)
    return Path("used")


@pytest.mark.parametrize(
    ("lens", "is_masked"), [(None, False), (BARREL, True), ("OPENCV_FISHEYE 0.1 0 0 0", False)]
)
def test_photos_and_cameras_are_those_that_upstream_holds(tiny_copy: Path, lens, is_masked):
    parser = DeSplatColmapDataParserConfig(data=tiny_copy)
    if is_masked:
        parser.masks_path = mask_photos(tiny_copy)
    if lens is not None:
        distort(tiny_copy, lens)
    whole, other = manager(parser), manager(copy.deepcopy(parser), THREE_PHOTOS)
    for step in range(14):
        assert_same_view(whole.next_train(step), other.next_train(step))
        assert whole.get_train_rays_per_batch() == other.get_train_rays_per_batch()
    assert isinstance(other.cached_train, BoundedPhotos)
    assert_same(whole.sampler_state(), other.sampler_state())
    held_out = whole.fixed_indices_eval_dataloader, other.fixed_indices_eval_dataloader
    for view, same in zip(*held_out, strict=True):
        assert_same_view(view, same)


def assert_same_view(view: Any, other: Any) -> None:
    assert_same(view[1], other[1])
    assert_same(vars(view[0]), vars(other[0]))


@pytest.mark.parametrize(("free", "is_bounded"), [(10**6, False), (37_000, True)])
def test_what_the_machine_can_spare_decides(tiny_scene, monkeypatch, free, is_bounded):
    """8 photos of 4,608 bytes are 36,864; other programs need memory as well."""
    memory = SimpleNamespace(available=free, total=free)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
    photos = manager(RobustNerfDataParserConfig(data=tiny_scene.folder)).cached_train
    assert isinstance(photos, BoundedPhotos) == is_bounded


def run_of(tiny_run, output: Path, data: Path, bound: float | None, name: str) -> Any:
    config = dataclasses.replace(tiny_run(output), timestamp=name)
    config.pipeline.datamanager.dataparser.data = data
    config.pipeline.datamanager.photo_memory = bound
    return config


def test_a_photo_that_vanishes_is_named_and_what_is_trained_is_saved(
    tiny_copy: Path, tiny_run, tmp_path: Path, monkeypatch
):
    """Put back, the run goes on as if nothing had been, to the bits of one in enough memory."""
    whole = run_of(tiny_run, tmp_path, tiny_copy, None, "whole")
    set_up(whole).train()
    config = run_of(tiny_run, tmp_path, tiny_copy, THREE_PHOTOS, "lost")
    trainer, images, away = set_up(config), tiny_copy / "images", tiny_copy / "away"
    iteration = trainer.train_iteration

    def loses_photos(step: int) -> Any:
        if step == 7:
            images.rename(away)
        return iteration(step)

    monkeypatch.setattr(trainer, "train_iteration", loses_photos)
    with pytest.raises(CaptureError, match=r"clutter_000\d.png does not exist"):
        trainer.train()
    away.rename(images)
    done = trainer._steps_done
    assert 7 <= done <= 11  # three photos are in memory
    assert last_state(config)["step"] == done - 1
    resumed = run_of(tiny_run, tmp_path, tiny_copy, THREE_PHOTOS, "resumed")
    resumed.load_dir = config.get_checkpoint_dir()
    set_up(resumed, seed=99).train()
    assert_same(last_state(whole), last_state(resumed))
