"""Photos come in upright and with their own colours; damage is named."""

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from desplat_ns.core.errors import CaptureError
from desplat_ns.data import images
from desplat_ns.data.images import image_size, read_gt_mask, read_image, read_mask, resize_image


def test_samples_of_16_bits_are_divided_by_257_and_rounded(tmp_path: Path):
    # 65535 = 255 * 257; 257 k + 128 lies below the middle of k and k + 1, 257 k + 129 above it.
    samples = np.array([[0, 257, 257 * 100 + 128, 257 * 100 + 129, 65535]], dtype=np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), samples)
    assert read_image(tmp_path / "a.png")[0, :, 0].tolist() == [0, 1, 100, 101, 255]


def test_a_header_that_says_too_much_is_refused_before_pixels_take_memory(
    tmp_path: Path, photo_writer, monkeypatch: pytest.MonkeyPatch
):
    photo_writer(tmp_path / "a.png", 64, 64)
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:99])  # nothing to decode
    monkeypatch.setattr(images, "MOST_PIXELS", 64 * 64 - 1)
    for read in (read_image, image_size, read_mask):
        with pytest.raises(CaptureError, match=r"a\.png .*64x64 pixels"):
            read(tmp_path / "a.png")


@pytest.mark.parametrize("width", [20_000, 65_000])
def test_a_jpeg_that_says_too_much_is_refused_by_its_size_or_its_bytes(
    tmp_path: Path, photo_writer, width: int
):
    photo_writer(tmp_path / "a.jpg", 64, 64)
    before, after = (tmp_path / "a.jpg").read_bytes().split(b"\xff\xc0\x00\x11\x08", 1)
    size = struct.pack(">HH", 20_000, width)
    (tmp_path / "a.jpg").write_bytes(before + b"\xff\xc0\x00\x11\x08" + size + after[4:])
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=r"a\.jpg .*JPEG"):
            read(tmp_path / "a.jpg")


def test_pipes_names_that_are_no_text_and_integers_of_32_bits_are_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.jpg")
    for read in (read_image, image_size):
        with pytest.raises(CaptureError, match=r"pipe\.jpg"):
            read(tmp_path / "pipe.jpg")
    (tmp_path / os.fsdecode(b"\xfc.png")).write_bytes(b"\x89PNG")
    with pytest.raises(CaptureError, match="UTF-8"):
        read_image(tmp_path / os.fsdecode(b"\xfc.png"))
    Image.fromarray(np.ones((2, 2), np.int32)).save(tmp_path / "int.tif")
    with pytest.raises(CaptureError, match=r"int\.tif"):
        read_image(tmp_path / "int.tif")
    assert read_mask(tmp_path / "int.tif").all()


def test_what_is_transparent_does_not_bleed():
    image = np.array([[[200, 0, 0, 255], [0, 255, 0, 0]]], dtype=np.uint8)
    assert resize_image(image, 1, 1)[0, 0].tolist() == [200, 0, 0, 128]


@pytest.mark.parametrize(
    ("pixels", "expected"),
    [
        ([[0], [1], [255]], [False, True, True]),
        ([[255, 255], [255, 0], [255, 255]], [True, False, True]),
        ([[255, 255, 255, 255], [255, 255, 255, 0], [0, 0, 0, 255]], [True, False, False]),
        ([[0, 0, 0, 255], [0, 0, 0, 0], [0, 0, 0, 255]], [True, False, True]),
        ([[0, 0, 0, 255]] * 3, [False] * 3),
        ([[255, 0]] * 3, [False] * 3),
    ],
)
def test_black_may_be_transparent_or_dark(tmp_path: Path, pixels, expected: list[bool]):
    values = np.array([pixels], dtype=np.uint8)
    Image.fromarray(values.squeeze(-1) if values.shape[2] == 1 else values).save(tmp_path / "m.png")
    assert read_mask(tmp_path / "m.png").tolist() == [expected]


def test_a_true_mask_is_reduced_to_the_size_of_the_rendering(tmp_path: Path):
    large = np.zeros((6, 12), np.uint8)
    large[:, :3] = 255
    Image.fromarray(large).save(tmp_path / "big.png")
    expected = torch.tensor([[True, False, False, False]] * 2)[..., None]
    assert torch.equal(read_gt_mask(tmp_path / "big.png", 4, 2), expected)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_in_a_true_mask_of_0_and_1_what_is_1_counts(tmp_path: Path, kind: type):
    Image.fromarray(np.array([[0, 1, 1, 0]] * 2, kind)).save(tmp_path / "a.png")
    expected = torch.tensor([[False, True, True, False]] * 2)[..., None]
    assert torch.equal(read_gt_mask(tmp_path / "a.png", 4, 2), expected)
