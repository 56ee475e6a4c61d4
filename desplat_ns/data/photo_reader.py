"""Single photos of a split as nerfstudio caches them: undistorted where the lens bends."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, Literal

import numpy as np
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.datamanagers.full_images_datamanager import _undistort_image

from desplat_ns.data.dataset import CaptureDataset

Photo = dict[str, Any]
"""What `CaptureDataset.get_data` gives: `image_idx`, `image`, perhaps `mask`."""

ImageType = Literal["uint8", "float32"]

_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")


class PhotoReader:
    """Reads photos one by one, to the last bit as nerfstudio 1.1.5 reads them all
    (`FullImageDatamanager._load_images`).

    Undistorting crops, and the dataset's cameras become those of what is left. Upstream sets them
    as it reads; here they are set before any photo is read.
    """

    def __init__(self, dataset: CaptureDataset, image_type: ImageType):
        """Sets the dataset's cameras, so that a dataset may have one reader only."""
        self._dataset = dataset
        self._image_type: ImageType = image_type
        self._lenses = deepcopy(dataset.cameras)
        self._set_cameras()

    def __call__(self, index: int) -> Photo:
        """A photo of the split.

        Raises:
            CaptureError: it cannot be read (any more), or does not fit its camera.
        """
        photo = self._dataset.get_data(index, self._image_type)
        lens = _bent_lens(self._lenses, index)
        if lens is not None:
            _, image, mask = _undistorted(lens, photo, photo["image"].numpy())
            photo["image"] = torch.from_numpy(image)
            if mask is not None:
                photo["mask"] = mask
        return photo

    def _set_cameras(self) -> None:
        """Photos of one lens are cropped alike: a black one is undistorted for each lens."""
        known: dict[tuple[float, ...], tuple[float, ...]] = {}
        for index in range(len(self._dataset)):
            lens = _bent_lens(self._lenses, index)
            if lens is None:
                continue
            numbers = [getattr(lens, name).item() for name in (*_NUMBERS, "camera_type")]
            kind = (*numbers, *lens.distortion_params.tolist())
            if kind not in known:
                black = np.zeros((int(lens.height), int(lens.width), 3), np.uint8)
                K, image, _ = _undistorted(lens, {}, black)
                sides = image.shape[1], image.shape[0]
                known[kind] = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), *sides
            for name, value in zip(_NUMBERS, known[kind], strict=True):
                getattr(self._dataset.cameras, name)[index] = value


def _bent_lens(cameras: Cameras, index: int) -> Any:
    """One camera, None where it is a pinhole."""
    lens = cameras[index].reshape(())
    if lens.distortion_params is None or bool(torch.all(lens.distortion_params == 0)):
        return None
    return lens


def _undistorted(lens: Any, photo: Photo, image: np.ndarray) -> Any:
    """nerfstudio's: intrinsics [3, 3], image [h, w, C], mask [h, w, 1] or None."""
    K, distortion = lens.get_intrinsics_matrices().numpy(), lens.distortion_params.numpy()
    return _undistort_image(lens, distortion, photo, image, K)
