"""Photos of one split at the size of their cameras, undistorted where the lens bends.

Letters in shapes: H x W pixels, C channels (3 or 4).
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import UInt8
from nerfstudio.data.datamanagers.full_images_datamanager import _undistort_image
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs
from nerfstudio.data.datasets.base_dataset import InputDataset

from desplat_ns.cameras.views import is_distorted
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.downscale import SIZE_TOLERANCE
from desplat_ns.data.images import image_size, read_image, read_mask, resize_image, resize_mask

Photo = dict[str, Any]
"""What `CaptureDataset.get_data` gives: `image_idx`, `image`, perhaps `mask`."""


class CaptureDataset(InputDataset):
    """nerfstudio's dataset: photos of any format, reduced by area to the size of their cameras."""

    def __init__(self, dataparser_outputs: DataparserOutputs, scale_factor: float = 1.0):
        super().__init__(dataparser_outputs, scale_factor)
        # Kept here because undistortion crops: it changes the cameras, not the files.
        widths, heights = self.cameras.width.flatten(), self.cameras.height.flatten()
        self.sizes: list[tuple[int, int]] = list(
            zip(widths.tolist(), heights.tolist(), strict=True)
        )

    def check_photos(self) -> None:
        """Look at the headers of all photos, before hours of training. Raises CaptureError: photos
        that are missing, unreadable, or do not fit their cameras."""
        for path, size in zip(self.image_filenames, self.sizes, strict=True):
            check_size(path, image_size(path, size), size)

    def get_numpy_image(self, image_idx: int) -> UInt8[np.ndarray, "H W C"]:
        """The photo at its camera's size. Raises CaptureError: it cannot be read, or does not fit
        its camera."""
        path = self.image_filenames[image_idx]
        image = read_image(path, self.sizes[image_idx])
        check_size(path, (image.shape[1], image.shape[0]), self.sizes[image_idx])
        return resize_image(image, *self.sizes[image_idx])

    def get_data(
        self, image_idx: int, image_type: Literal["uint8", "float32"] = "float32"
    ) -> Photo:
        """`image_idx`, `image` [H, W, C] and, if the capture has masks, `mask` [H, W, 1] (bool):
        True where the photo may be used."""
        read = self.get_image_uint8 if image_type == "uint8" else self.get_image_float32
        data: Photo = {"image_idx": image_idx, "image": read(image_idx)}
        if self._dataparser_outputs.mask_filenames is not None:
            path, size = self._dataparser_outputs.mask_filenames[image_idx], self.sizes[image_idx]
            mask = read_mask(path, size)
            check_size(path, (mask.shape[1], mask.shape[0]), size)
            data["mask"] = torch.from_numpy(resize_mask(mask, *size))[..., None]
        return data


def check_size(path: Path, size: tuple[int, int], camera: tuple[int, int]) -> None:
    """Raise CaptureError, with the file and both sizes (width, height), unless a photo is as large
    as its camera, or larger and of the same shape."""
    # Of the longer side: the shorter one may have been rounded up to one pixel.
    ratio = size[1] / camera[1] if camera[1] > camera[0] else size[0] / camera[0]
    off = max(abs(size[0] / ratio - camera[0]), abs(size[1] / ratio - camera[1]))
    if size[0] >= camera[0] and size[1] >= camera[1] and off <= SIZE_TOLERANCE + 1:
        return
    raise CaptureError(
        f"Photo {path} is {size[0]}x{size[1]} pixels, but its camera in the reconstruction is "
        f"{camera[0]}x{camera[1]} (after downscaling). Where photos were reduced after "
        "the reconstruction, add --downscale-factor with the camera's width there over "
        f"{size[0]}. Else the reconstruction must be made from these photos: turn or resize them "
        "(`mogrify -auto-orient` turns them) and run COLMAP again, or name the folder that it was "
        "made from with --images-path."
    )


_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")


def photo_reader(dataset: CaptureDataset) -> Callable[[int], Photo]:
    """Reads photos one by one, to the last bit as nerfstudio 1.1.5 reads them all
    (`FullImageDatamanager._load_images`); raises as `CaptureDataset.get_numpy_image`.

    Undistorting crops: the dataset's cameras become those of what is left before any photo is read,
    so that a dataset may have one reader only. Photos of one lens are cropped alike: a black one is
    undistorted for each lens.
    """
    lenses, bent = deepcopy(dataset.cameras), dict[int, Any]()
    known: dict[tuple[float, ...], tuple[float, ...]] = {}
    for index in range(len(dataset)):
        lens: Any = lenses[index].reshape(())
        if not is_distorted(lens):
            continue
        bent[index] = lens
        numbers = [getattr(lens, name).item() for name in (*_NUMBERS, "camera_type")]
        kind = (*numbers, *lens.distortion_params.tolist())
        if kind not in known:
            black = np.zeros((int(lens.height), int(lens.width), 3), np.uint8)
            K, image, _ = _undistorted(lens, {}, black)
            sides = image.shape[1], image.shape[0]
            known[kind] = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), *sides
        for name, value in zip(_NUMBERS, known[kind], strict=True):
            getattr(dataset.cameras, name)[index] = value

    def read(index: int) -> Photo:
        photo = dataset.get_data(index, "uint8")
        if index in bent:
            _, image, mask = _undistorted(bent[index], photo, photo["image"].numpy())
            photo["image"] = torch.from_numpy(image)
            if mask is not None:
                photo["mask"] = mask
        return photo

    return read


def _undistorted(lens: Any, photo: Photo, image: np.ndarray) -> Any:
    """nerfstudio's: intrinsics [3, 3], image [h, w, C], mask [h, w, 1] or None."""
    K, distortion = lens.get_intrinsics_matrices().numpy(), lens.distortion_params.numpy()
    return _undistort_image(lens, distortion, photo, image, K)
