"""Masks lie over the photos as they are on disk: their size, their lens, their names."""

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.images import read_grey
from desplat_ns.tools.export.masks import (
    dilated,
    distractor_mask,
    mask_names,
    photos_on_disk,
    pinhole_of,
)
from desplat_ns.tools.process.photos import prepare_photos
from desplat_ns.tools.process.reconstruction import Model
from desplat_ns.tools.process.request import Request
from desplat_ns.tools.process.undistortion import undistort
from desplat_ns.training.datamanager import DeSplatDataManager
from tests.helpers.small_model import camera, cameras, distractors_of, make_model


def with_distractors():
    """A model whose distractors cover half of the second view."""
    model = make_model().eval()
    params = distractors_of(model, 1)
    params["opacities"].data[:] = 5.0
    params["means"].data[:, 0] -= params["means"].data[:, 0].mean()
    params["scales"].data[:] -= 0.5
    return model


def test_a_mask_is_that_of_the_models_own_output_at_the_photos_full_size():
    model, small = with_distractors(), cameras()[1:2]
    mask = distractor_mask(model, 1, small)
    shown = model.get_outputs_for_camera(camera(1))["distractor_mask"][..., 0].numpy()
    assert np.array_equal(mask, shown)
    assert 0 < mask.mean() < 1
    large = Cameras(
        small.camera_to_worlds, small.fx * 4, small.fy * 4, small.cx * 4, small.cy * 4, 96, 80
    )
    of_large = distractor_mask(model, 1, large)
    assert of_large.shape == (80, 96)
    assert np.mean(of_large[2::4, 2::4] == mask) > 0.9


def test_a_photo_without_distractors_has_an_empty_mask():
    model = with_distractors()
    for parameter in distractors_of(model, 0).values():
        parameter.data = parameter.data[:0]
    assert not distractor_mask(model, 0, cameras()[:1]).any()


@pytest.mark.parametrize("pixels", [0.0, 1.5, 7.2])
def test_a_grown_mask_holds_what_is_no_farther_than_the_distance(pixels: float):
    mask = torch.rand(30, 40, generator=torch.Generator().manual_seed(0)).numpy() > 0.99
    rows, columns = np.mgrid[:30, :40]
    inside = np.argwhere(mask)
    squared = (rows[..., None] - inside[:, 0]) ** 2 + (columns[..., None] - inside[:, 1]) ** 2
    assert np.array_equal(dilated(mask, pixels), squared.min(-1) <= pixels**2)
    assert not dilated(np.zeros((5, 6), bool), pixels).any()


K = np.array([[60.0, 0, 41], [0, 58, 33], [0, 0, 1]])
WIDTH, HEIGHT = 80, 64


def lens(kind: CameraType, *distortion: float) -> Cameras:
    """k1, k2, k3, k4, p1, p2."""
    pinhole = (torch.eye(4)[None, :3], K[0, 0], K[1, 1], K[0, 2], K[1, 2], WIDTH, HEIGHT)
    return Cameras(*pinhole, torch.tensor([distortion]), torch.tensor([[kind.value]]))


def project(kind: CameraType, distortion: tuple[float, ...], point: np.ndarray) -> np.ndarray:
    """Where OpenCV's lens model shows a point, in pixels from the image's corner."""
    k1, k2, k3, k4, p1, p2 = distortion
    place, zero = point.reshape(1, 1, 3), np.zeros(3)
    if kind == CameraType.FISHEYE:
        pixels, _ = cv2.fisheye.projectPoints(place, zero, zero, K, np.array([k1, k2, k3, k4]))
    else:
        pixels, _ = cv2.projectPoints(place, zero, zero, K, np.array([k1, k2, p1, p2, k3]))
    return pixels.reshape(2)


@pytest.mark.parametrize(
    ("kind", "distortion"),
    [
        (CameraType.PERSPECTIVE, (0.12, -0.05, 0.01, 0.0, 0.004, -0.003)),
        (CameraType.PERSPECTIVE, (-0.25, 0.06, 0.0, 0.0, 0.0, 0.0)),
        (CameraType.FISHEYE, (0.05, -0.01, 0.002, 0.0, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize("point", [(0.45, 0.3), (-0.5, 0.4)])
def test_a_disc_in_the_pinhole_is_found_where_the_lens_shows_it(
    kind: CameraType, distortion: tuple[float, ...], point: tuple[float, float]
):
    pinhole, to_photo = pinhole_of(lens(kind, *distortion))
    photo = to_photo(disc_at(pinhole, np.array(point)))
    assert photo.shape == (HEIGHT, WIDTH)
    expected = project(kind, distortion, np.array([*point, 1.0]))
    off = np.abs(middle_of(photo) - expected).max()
    assert off < 0.15, "the disc of 2 pixels is bent by a tenth"


def disc_at(pinhole: Cameras, point: np.ndarray) -> np.ndarray:
    """A soft disc of 2 pixels at x / z and y / z."""
    matrix = pinhole.get_intrinsics_matrices()[0].numpy()
    place = matrix[:2, :2] @ point + matrix[:2, 2]
    rows, columns = np.mgrid[: int(pinhole.height), : int(pinhole.width)] + 0.5
    squared = (columns - place[0]) ** 2 + (rows - place[1]) ** 2
    return np.exp(-squared / 8).astype(np.float32)


def middle_of(image: np.ndarray) -> np.ndarray:
    """Of what is bright, in pixels from the image's corner."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    return np.array([(image * columns).sum(), (image * rows).sum()]) / image.sum()


def test_what_a_capture_shows_is_masked_where_the_photo_that_process_was_given_has_it(
    tmp_path: Path, model_writer: Any
):
    """Given twice as large as the copies of which the poses were found."""
    sources, out, given = ["a.png", "b.png"], tmp_path / "out", tmp_path / "photos"
    places = np.array([[70.0, 60.0], [560.0, 400.0]])
    given.mkdir()
    for source, place in zip(sources, places, strict=True):
        rows, columns = np.mgrid[:480, :640] + 0.5
        is_near = np.hypot(columns - place[0], rows - place[1]) < 8
        cv2.imwrite(str(given / source), 255 * np.repeat(is_near[..., None], 3, 2).astype(np.uint8))
    photos = prepare_photos(given, sources, out / "work" / "photos", 320)
    copies = tuple(photo.copy for photo in photos)
    lens = ("1 OPENCV 320 240 250 245 165 118 -0.2 0.05 0.003 -0.002",)
    model = Model(model_writer(out / "work" / "model", copies, lens), copies, 2, 3, 0.4)
    undistort(Request(given, out, longest_side=320), model, photos)
    manager = manager_of(DeSplatColmapDataParserConfig(data=out, eval_mode="all"))
    outputs = manager.train_dataparser_outputs
    for index, (name, bent) in enumerate(photos_on_disk(manager, given)):
        flat = read_grey(outputs.image_filenames[index])
        matrix = outputs.cameras[index].get_intrinsics_matrices().numpy()
        ray = (middle_of(flat * (flat > 0.2)) - matrix[:2, 2]) / np.diag(matrix)[:2]
        pinhole, to_photo = pinhole_of(bent)
        photo = to_photo(disc_at(pinhole, ray))
        assert (name, photo.shape) == (sources[index], (480, 640))
        assert np.abs(middle_of(photo) - places[index]).max() < 1
    shutil.rmtree(out / "originals")
    with pytest.raises(CaptureError, match="originals"):
        list(photos_on_disk(manager, given))


PHOTOS = ["left/0001.jpg", "left/0002.JPG", "right/0001.jpg"]


def test_colmap_appends_its_ending_and_nerfstudio_replaces_it_where_that_is_one_name_each():
    assert mask_names(PHOTOS, "colmap") == [f"{name}.png" for name in PHOTOS]
    without = ["left/0001.png", "left/0002.png", "right/0001.png"]
    assert mask_names(PHOTOS, "nerfstudio") == without
    twins = ["a/b.jpg", "a/b.png", "c.jpg"]
    assert len(set(mask_names(twins, "colmap"))) == 3
    with pytest.raises(ConfigError, match=r"a/b\.png"):
        mask_names(twins, "nerfstudio")


def test_a_reduced_copy_leads_to_the_photo_in_its_full_size(capture, photo_writer):
    data, names = capture(["s/a.png", "s/b.png"]), ["s/a.png", "s/b.png"]
    for name in names:
        photo_writer(data / "images_2" / name, 4, 3)
    (data / "images" / "s" / "b.png").unlink()
    options = DeSplatColmapDataParserConfig(data=data, eval_mode="all", downscale_factor=2)
    manager = manager_of(options)
    photos = [(name, int(camera.width)) for name, camera in photos_on_disk(manager)]
    assert photos == list(zip(names, [8, 4], strict=True))


def manager_of(options: DeSplatColmapDataParserConfig) -> DeSplatDataManager:
    """A data manager that knows its photos and reads none."""
    parser, manager = options.setup(), object.__new__(DeSplatDataManager)
    outputs = parser.get_dataparser_outputs("train")
    manager.__dict__ |= {"dataparser": parser, "train_dataparser_outputs": outputs}
    return manager
