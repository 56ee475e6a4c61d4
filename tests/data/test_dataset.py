"""Photos come at the size of their cameras, whatever their own; what does not fit is named."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.dataset import CaptureDataset, check_size

CAMERAS = ("1 PINHOLE 8 6 10 10 4 3", "2 PINHOLE 12 4 10 10 6 2", "3 PINHOLE 8 6 10 10 4 3")


def dataset_of(data: Path, scale_factor: float = 1.0, **options) -> CaptureDataset:
    parser = DeSplatColmapDataParserConfig(data=data, eval_mode="all", **options).setup()
    return CaptureDataset(parser.get_dataparser_outputs("train"), scale_factor)


def test_photos_of_differing_sizes_keep_them(capture, photo_writer):
    data = capture(cameras=CAMERAS)
    pixels = photo_writer(data / "images" / "b.png", 12, 4)
    dataset = dataset_of(data)
    dataset.check_photos()
    sizes = [tuple(dataset.get_data(i)["image"].shape) for i in range(3)]
    assert sizes == [(6, 8, 3), (4, 12, 3), (6, 8, 3)]
    np.testing.assert_array_equal(dataset.get_numpy_image(1), pixels)


def test_a_downscale_factor_takes_means(capture):
    data = capture()
    with Image.open(data / "images" / "a.png") as photo:
        pixels = np.asarray(photo).astype(np.float64)
    reduced = dataset_of(data, downscale_factor=2).get_data(0, "uint8")["image"].numpy()
    expected = pixels.reshape(3, 2, 4, 2, 3).mean(axis=(1, 3))
    assert np.abs(reduced - expected).max() <= 0.5 + 1e-6
    by_camera_res_scale_factor = dataset_of(data, scale_factor=0.5).get_data(0)["image"]
    assert by_camera_res_scale_factor.shape == (3, 4, 3)


def test_masks_come_as_booleans_at_the_cameras_size(capture):
    data = capture()
    (data / "masks").mkdir()
    for name in "abc":
        mask = np.zeros((6, 8), dtype=np.uint8)
        mask[:, 4:] = 255
        Image.fromarray(mask).save(data / "masks" / f"{name}.png")
    mask = dataset_of(data, masks_path=Path("masks"), downscale_factor=2).get_data(0)["mask"]
    assert (mask.shape, mask.dtype) == ((3, 4, 1), torch.bool)
    assert mask[0, :, 0].tolist() == [False, False, True, True]


def test_a_photo_that_is_turned_missing_or_corrupt_is_named(capture, photo_writer):
    data = capture()
    dataset, photo = dataset_of(data), data / "images" / "b.png"
    photo_writer(photo, 6, 8)
    with pytest.raises(CaptureError, match=r"b\.png is 6x8 .* 8x6 "):
        dataset.check_photos()
    photo.write_bytes(b"\x89PNG nothing")
    with pytest.raises(CaptureError, match=r"b\.png"):
        dataset.check_photos()
    photo.unlink()
    with pytest.raises(CaptureError, match=r"b\.png does not exist"):
        dataset.check_photos()


@pytest.mark.parametrize(
    ("size", "camera", "fits"),
    [
        ((270, 480), (270, 480), True),
        ((1297, 840), (648, 420), True),
        ((8, 6), (7, 5), True),
        ((1, 8), (1, 4), True),  # a side of one pixel stays
        ((5, 80), (1, 10), True),
        ((480, 270), (270, 480), False),
        ((3024, 4032), (1008, 756), False),
        ((1000, 800), (500, 300), False),
        ((100, 800), (1, 100), False),
    ],
)
def test_photos_fit_cameras_of_their_shape_and_no_larger(size, camera, fits: bool):
    if fits:
        check_size(Path("a.png"), size, camera)
    else:
        with pytest.raises(CaptureError, match=f"a.png is {size[0]}x{size[1]}"):
            check_size(Path("a.png"), size, camera)
