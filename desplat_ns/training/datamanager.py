"""Serves full photos with their cameras, and says which training view a camera is."""

import os
import random
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import torch
import tyro
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.configs.dataparser_configs import all_dataparsers
from nerfstudio.data.datamanagers.full_images_datamanager import (
    FullImageDatamanager,
    FullImageDatamanagerConfig,
)
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig, DataparserOutputs
from nerfstudio.data.dataparsers.blender_dataparser import Blender
from torch import Tensor

from desplat_ns.cameras.views import is_distorted
from desplat_ns.core.console import announce, list_names
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.data.colmap import GT_MASKS, DeSplatColmapDataParser
from desplat_ns.data.dataset import CaptureDataset, Photo, photo_reader
from desplat_ns.data.layouts import OURS, DeSplatDataParserConfig, without_prompts
from desplat_ns.data.photo_cache import SHARE, BoundedPhotos, free_memory, photo_bytes
from desplat_ns.data.splits import in_both
from desplat_ns.data.training_views import image_names
from desplat_ns.survey.observations import colors_of_photos

if TYPE_CHECKING:
    AnyDataParser = DataParserConfig
else:
    AnyDataParser = tyro.conf.OmitSubcommandPrefixes[
        tyro.extras.subcommand_type_from_defaults({**OURS, **all_dataparsers}, prefix_names=False)
    ]
"""Union of the configurations of nerfstudio's dataparsers and ours, as tyro's subcommands."""


@dataclass
class DeSplatDataManagerConfig(FullImageDatamanagerConfig):
    """Full photos."""

    _target: type = field(default_factory=lambda: DeSplatDataManager)
    dataparser: AnyDataParser = field(default_factory=DeSplatDataParserConfig)
    cache_images_type: Annotated[Literal["uint8"], tyro.conf.Suppress] = "uint8"
    """Photos have 8 bits; nerfstudio's float32 would take four times the memory."""
    photo_memory: float | None = ranged(None, "(0, inf)")
    """GB of memory for decoded photos. Where they take more, they are read again and again, before
    their turn and in the background, which changes nothing else. By default 40% of the
    memory that is free."""

    def setup(self, **kwargs: Any) -> "DeSplatDataManager":
        """The data manager, once the dataparser is settled."""
        self.settle_dataparser()
        return super().setup(**kwargs)

    def settle_dataparser(self) -> DataParserConfig:
        """Put the dataparser that reads the capture in the place of `desplat-data` or of upstream's
        that ask questions, and return it. Raises CaptureError where there is no capture, and as
        `without_prompts` and `check_ranges`."""
        check_ranges(self, "--pipeline.datamanager")
        if self.data is not None:
            self.dataparser.data = Path(self.data)  # pyright: ignore[reportAttributeAccessIssue]
        data = self.dataparser.data
        if not os.path.exists(data) and "data_dir" not in vars(self.dataparser):  # nuscenes' name
            raise CaptureError(
                f"There is no capture {data}. Put it there, or name its folder with --data, which "
                "desplat-eval, desplat-report and desplat-export take for a trained run."
            )
        self.dataparser = without_prompts(self.dataparser)
        return self.dataparser


def training_split(config: DeSplatDataManagerConfig) -> DataparserOutputs:
    """Cameras, photos and points of the training split, without a data manager and its photos."""
    return config.settle_dataparser().setup().get_dataparser_outputs("train")


class DeSplatDataManager(FullImageDatamanager[CaptureDataset]):
    """nerfstudio's full-image datamanager, also without CUDA. The cameras of training views carry
    `metadata["train_idx"]` ([1, 1], the number of the view)."""

    config: DeSplatDataManagerConfig

    def create_train_dataset(self) -> CaptureDataset:
        """Training photos, numbered. Raises CaptureError where they are fewer than two, or some
        cannot be used."""
        dataset = super().create_train_dataset()
        if len(dataset) < 2:
            raise CaptureError(
                f"{self.get_datapath()} has {len(dataset)} training photos; two or more are needed."
                " Check the options that choose them (--eval-mode, --train-split-fraction, "
                "or train_list.txt)."
            )
        if self.test_mode != "inference":  # ns-render and ns-viewer may never look at the photos
            dataset.check_photos()
        capture = self.train_dataparser_outputs
        colors = capture.metadata.get("points3D_rgb", torch.zeros(0, 3))
        is_training = self.test_mode == "val"  # what was trained has learned its colours
        if is_training and len(colors) > 0 and bool((colors == colors[0]).all()):
            capture.metadata["points3D_rgb"] = torch.from_numpy(colors_of_photos(capture))
            announce(
                f"The {len(colors)} points have no colours, or all the same one: they start in "
                "those of the photos."
            )
        numbers = torch.arange(len(dataset))[:, None]
        dataset.cameras.metadata = {**(dataset.cameras.metadata or {}), "train_idx": numbers}
        dataset.metadata["train_cameras"] = dataset.cameras
        dataset.metadata["train_image_names"] = image_names(dataset.image_filenames)
        return dataset

    def create_eval_dataset(self) -> CaptureDataset:
        """Held-out photos. Raises CaptureError where there is none, or some cannot be used."""
        dataset = super().create_eval_dataset()
        if len(dataset) == 0:
            raise CaptureError(
                f"{self.get_datapath()} has no evaluation photos: all {len(self.train_dataset)} "
                "are used for training. Hold some out with --eval-mode interval (every eighth), or "
                "with a smaller --train-split-fraction."
            )
        if self.test_mode != "inference":
            dataset.check_photos()
            self._check_held_out(dataset.image_filenames)
        return dataset

    def _check_held_out(self, photos: list[Path]) -> None:
        """Raise CaptureError where photos train and are held out. A trained run, `--eval-mode all`,
        and data parsers whose splits no file of the capture decides, are warned."""
        parser, is_training = self.dataparser, self.test_mode == "val"
        if is_training:
            with suppress(Exception):  # it may not be there; upstream's errors are of many kinds
                photos = [*{*photos, *parser.get_dataparser_outputs("test").image_filenames}]
        if not (both := in_both(self.train_dataset.image_filenames, photos)):
            return
        told = (
            f"{len(both)} of {len(photos)} held-out photos of {self.get_datapath()} also train: "
            f"{list_names(both)}. Their scores would say nothing of new views."
        )
        can_be_mended = isinstance(parser, DeSplatColmapDataParser | Blender)
        if can_be_mended and is_training and getattr(parser.config, "eval_mode", "") != "all":
            by = getattr(parser, "split_by", "transforms_train.json and those beside it")
            raise CaptureError(f"{told} Take each out of one split; they are chosen by {by}.")
        announce(told, warning=True)

    @property
    def train_image_names(self) -> list[str]:
        """Names of the training photos in the order of `train_idx`, below their common folder."""
        return image_names(self.train_dataset.image_filenames)

    def remembered(self) -> dict[str, Tensor]:
        """The training cameras, as pinholes, and the capture's frame, for a checkpoint."""
        outputs, parser = self.train_dataparser_outputs, self.dataparser
        transform, cameras = outputs.dataparser_transform, self.train_dataset.cameras
        if isinstance(parser, DeSplatColmapDataParser):  # in float64
            transform = parser.oriented.transform
        scale = torch.tensor(outputs.dataparser_scale, dtype=torch.float64)
        numbers = ("camera_to_worlds", "fx", "fy", "cx", "cy", "width", "height")
        kept = {name: getattr(cameras, name).cpu() for name in numbers}
        return {**kept, "transform": transform, "scale": scale}

    def gt_masks(self) -> list[tuple[Cameras, Path]]:
        """The camera of each training view whose distractors are known, and their mask's file."""
        paths = self.train_dataparser_outputs.metadata.get(GT_MASKS, [])
        cameras = self.train_dataset.cameras
        return [
            (cameras[index : index + 1].to(self.device), Path(path))
            for index, path in enumerate(paths)
            if path is not None
        ]

    def sampler_state(self) -> dict[str, Any]:
        """The order in which views come next, as plain values."""
        state: dict[str, Any] = {
            "unseen": [int(i) for i in self.train_unseen_cameras],
            "eval_unseen": [int(i) for i in self.eval_unseen_cameras],
        }
        if hasattr(self, "random_generator"):
            state["random"] = self.random_generator.getstate()
        if hasattr(self, "train_unsampled_epoch_count"):
            state["unsampled"] = [float(count) for count in self.train_unsampled_epoch_count]
        return state

    def load_sampler_state(self, state: dict[str, Any]) -> None:
        """Go on with the order that `sampler_state` gave, of the same training views."""
        self.train_unseen_cameras = list(state["unseen"])
        if all(i < len(self.eval_dataset) for i in state["eval_unseen"]):
            self.eval_unseen_cameras = list(state["eval_unseen"])
        if "random" in state:
            version, numbers, gauss = state["random"]  # a list in older checkpoints
            self.random_generator = random.Random()
            self.random_generator.setstate((version, tuple(numbers), gauss))
        if "unsampled" in state:
            self.train_unsampled_epoch_count = np.array(state["unsampled"])

    # --- photos in memory --------------------------------------------------------------------

    def next_train(self, step: int) -> tuple[Cameras, Photo]:
        """The next view. Where its photo cannot be read (CaptureError), it stays the next one."""
        index = self.train_unseen_cameras[0]
        try:
            return super().next_train(step)
        except CaptureError:
            self.train_unseen_cameras.insert(0, index)
            raise

    def get_train_rays_per_batch(self) -> int:
        """Pixels of the first training photo; upstream (1.1.5) asks for the photo itself."""
        cameras = self.train_dataset.cameras
        return int(cameras.width[0] * cameras.height[0])

    def training_images(
        self, chosen: Sequence[int]
    ) -> Iterator[tuple[int, Cameras, dict[str, Any]]]:
        """Training views with their camera [1] and their photo as trained on, undistorted, `image`
        of 8 bits and perhaps `mask`. Raises CaptureError of a photo that cannot be read."""
        dataset, undistorted = self.train_dataset, None
        if is_distorted(dataset.cameras):
            undistorted = self.cached_train  # changes the cameras
        for index in chosen:
            batch = undistorted[index] if undistorted else dataset.get_data(index, "uint8")
            yield index, dataset.cameras[index : index + 1], batch

    def _load_images(
        self, split: Literal["train", "eval"], cache_images_device: Literal["cpu", "gpu"]
    ) -> Any:
        """Photos by their numbers: all of them, or `BoundedPhotos` of training where they do not
        fit beside the held-out ones."""
        # Upstream pins memory for "cpu", which needs a CUDA driver; "gpu" means `self.device`.
        if torch.device(self.device).type == "cpu":
            cache_images_device = "gpu"
        if split == "eval":
            return super()._load_images(split, cache_images_device)
        memory = self.config.photo_memory
        place = torch.device(self.device if cache_images_device == "gpu" else "cpu")
        room = SHARE * free_memory(place) if memory is None else 1e9 * memory
        needed = photo_bytes(self.train_dataset)
        room -= sum(photo_bytes(self.eval_dataset))
        is_training = self.test_mode == "val"  # else few training photos are looked at
        if is_training and sum(needed) <= room:
            return super()._load_images(split, cache_images_device)
        most = int(room // max(needed))
        if is_training:
            announce(
                f"Training photos take {sum(needed) / 1e9:.3g} GB decoded. {max(1, most)} of "
                f"{len(needed)} are held at a time; the others are read before their turn."
            )
        reader = photo_reader(self.train_dataset)
        self.train_cameras = self.train_dataset.cameras.to(self.device)
        return BoundedPhotos(
            reader, len(needed), most, lambda: self.train_unseen_cameras if is_training else ()
        )
