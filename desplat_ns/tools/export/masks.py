"""Distractor masks over the photos as they lie on disk: at their full size, through their lens.
Letters in shapes: H x W pixels of the photo, h x w of the pinhole's image, which is rendered."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.cameras.views import is_distorted
from desplat_ns.core.console import announce, list_names, progress_over
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.run_files import RunFiles
from desplat_ns.core.whole import plain_errors, whole_folder
from desplat_ns.data.colmap import DeSplatColmapDataParser
from desplat_ns.data.downscale import PhotoSource
from desplat_ns.data.images import image_size, read_mask, resize_mask
from desplat_ns.data.poses import make_cameras
from desplat_ns.data.reconstruction import Frame, read_reconstruction
from desplat_ns.data.training_views import image_names
from desplat_ns.layers import MASK_THRESHOLD
from desplat_ns.model import DeSplatModel
from desplat_ns.tools.commands.export import Masks
from desplat_ns.tools.export.formats import Naming
from desplat_ns.tools.loading import load_run
from desplat_ns.tools.process.request import ORIGINALS
from desplat_ns.training.datamanager import DeSplatDataManager

WIDEST = 5.0
"""Tangent of the angle from the optical axis beyond which a pinhole is not drawn (79 degrees)."""
MARGIN = 1
"""Pixels around what is seen, for interpolation at the border."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
"""When inverting a lens model stops; OpenCV's default of 5 rounds is off by pixels in corners."""


def export_masks(files: RunFiles, asked: Masks) -> None:
    """Write distractor masks of photos as PNG, at the photo's full size. Raises as `load_run`,
    `photos_on_disk` and `others_for_training`; ConfigError where the run has no distractors."""
    pipeline, output = load_run(files).pipeline, asked.output
    model, manager = pipeline.model, pipeline.datamanager
    if model.distractors is None:
        raise ConfigError(
            f"The run of {files.config} has no distractors, so there is nothing to mask: "
            "--pipeline.model.effects.distractors was False. Train without it."
        )
    photos = list(photos_on_disk(manager, asked.originals))
    others, given = others_for_training(manager) if asked.for_training else ([], None)
    names = mask_names([name for name, _ in photos] + [f.name for f in others], asked.names)
    shares = []
    drawing = progress_over(len(names), "Drawing masks...")
    with plain_errors(output), whole_folder(output) as folder, drawing as advance:
        for index, name in enumerate(names):
            if index < len(photos):
                mask = dilated(distractor_mask(model, index, photos[index][1]), asked.dilate)
                shares.append(float(mask.mean()))
            else:
                frame = others[index - len(photos)]
                mask = np.zeros((frame.height, frame.width), bool)
            if given is not None:
                height, width = mask.shape
                mask |= ~resize_mask(read_mask(given[index], (width, height)), width, height)
            _, png = cv2.imencode(".png", np.uint8(255) * (mask == asked.invert))
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(png.tobytes())  # which tells of a full disk
            advance()
    announce(
        f"Saved {len(names)} masks to {output}: {names[0]}, ... They cover {np.mean(shares):.1%} "
        f"of the photos on average, {max(shares):.1%} at most. Empty masks: {shares.count(0.0)}."
    )


def photos_on_disk(
    manager: DeSplatDataManager, originals: Path | None = None
) -> Iterator[tuple[str, Cameras]]:
    """Of each training photo, in the order of the views: its path below the photos' folder, and the
    camera [1] at its full size, with its distortion. With the folder that `desplat-process` was
    given, of the `originals` in it. Raises CaptureError of a lost photo."""
    outputs, parser = manager.train_dataparser_outputs, manager.dataparser
    cameras, paths = outputs.cameras, outputs.image_filenames
    names = image_names(paths)
    if isinstance(parser, DeSplatColmapDataParser):
        frames = [parser.reconstruction.frames[index] for index in parser.views("train")]
        if originals is not None:
            frames = _before_undistortion(parser.config.data, frames)
            sources = [PhotoSource(Path(f.name), f.width, f.height) for f in frames]
            cameras = make_cameras(frames, sources, cameras.camera_to_worlds)
        names = [frame.name for frame in frames]
        whole = [(originals or parser.photos_folder) / name for name in names]
        both = zip(whole, paths, strict=True)
        paths = [a if originals or a.is_file() else b for a, b in both]
    for index, (path, name) in enumerate(zip(paths, names, strict=True)):
        camera = cameras[index : index + 1]
        trained = int(camera.width), int(camera.height)
        width, height = image_size(path, trained)
        x_ratio, y_ratio = width / trained[0], height / trained[1]
        camera.fx, camera.cx = camera.fx * x_ratio, camera.cx * x_ratio
        camera.fy, camera.cy = camera.fy * y_ratio, camera.cy * y_ratio
        camera.width = torch.full_like(camera.width, width)
        camera.height = torch.full_like(camera.height, height)
        yield name, camera


def _before_undistortion(data: Path, frames: Sequence[Frame]) -> list[Frame]:
    """Photos of a capture as `desplat-process` read them. Raises CaptureError where the capture
    does not say how they were bent."""
    if not (data / ORIGINALS).is_dir():
        raise CaptureError(
            f"{data} has no {ORIGINALS}/, which `desplat-process` writes. Leave out --originals, "
            "or make the capture anew and train on it."
        )
    known = {frame.image_id: frame for frame in read_reconstruction(data, ORIGINALS).frames}
    return [known[frame.image_id] for frame in frames]


def others_for_training(manager: DeSplatDataManager) -> tuple[list[Frame], list[Path] | None]:
    """The capture's photos that did not train; and, if the run was given masks, those of the
    training photos and then of these. Raises ConfigError where training takes no masks."""
    parser = manager.dataparser
    if not isinstance(parser, DeSplatColmapDataParser):
        raise ConfigError(f"{type(parser).__name__} takes no masks. Leave out --for-training.")
    frames, trained = parser.reconstruction.frames, parser.views("train")
    others = [frame for index, frame in enumerate(frames) if index not in {*trained}]
    if manager.train_dataparser_outputs.mask_filenames is None:
        return others, None
    return others, parser.masks([*(frames[index] for index in trained), *others])


def mask_names(photos: Sequence[str], naming: Naming) -> list[str]:
    """Paths of photos' masks below the masks' folder, from the photos' below theirs. Raises
    ConfigError where two photos would have the same mask."""
    if naming == "colmap":
        return [f"{photo}.png" for photo in photos]
    names = [str(PurePosixPath(photo).with_suffix(".png")) for photo in photos]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ConfigError(
            f"--names {naming} calls the masks of several photos the same: {list_names(twice)}. "
            "Add `--names colmap`, which keeps the photos' endings."
        )
    return names


def pinhole_of(camera: Cameras) -> tuple[Cameras, Callable[[np.ndarray], np.ndarray]]:
    """The pinhole [1] that sees all that the photo of a camera [1] shows, at the same focal
    lengths, and what makes of its images [h, w] what the lens shows [H, W], 0 outside of them."""
    if not is_distorted(camera):
        return camera, lambda image: image
    rays = _slopes(camera)
    rays = np.where(np.isfinite(rays) & (np.abs(rays) <= WIDEST), rays, np.nan)
    least, most = np.nanmin(rays, axis=(0, 1)), np.nanmax(rays, axis=(0, 1))
    focal = np.array([float(camera.fx), float(camera.fy)])
    cx, cy = center = MARGIN - least * focal
    width, height = np.ceil((most - least) * focal).astype(int) + 2 * MARGIN
    size = int(width), int(height)
    pinhole = Cameras(camera.camera_to_worlds, camera.fx, camera.fy, float(cx), float(cy), *size)
    # of the photo's pixels, in the pinhole's image, from the middle of its first pixel
    places = np.nan_to_num(rays * focal + center, nan=-2.0).astype(np.float32) - 0.5
    x, y = np.moveaxis(places, 2, 0)
    return pinhole, lambda image: cv2.remap(image, x, y, cv2.INTER_LINEAR)


def _slopes(camera: Cameras) -> Float[np.ndarray, "H W 2"]:
    """x / z and y / z of the rays through the photo's pixel centres, in OpenCV's axes."""
    height, width = int(camera.height), int(camera.width)
    rows, columns = np.mgrid[:height, :width]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2) + 0.5
    matrix = camera.get_intrinsics_matrices()[0].double().numpy()
    assert camera.distortion_params is not None
    k1, k2, k3, k4, p1, p2 = camera.distortion_params[0].double().tolist()
    if int(camera.camera_type) == CameraType.FISHEYE.value:
        lens = np.array([k1, k2, k3, k4])
        slopes = cv2.fisheye.undistortPoints(pixels, matrix, lens, criteria=CRITERIA)
    else:
        lens = np.array([k1, k2, p1, p2, k3])
        slopes = cv2.undistortPointsIter(pixels, matrix, lens, np.eye(3), np.eye(3), CRITERIA)
    return slopes.reshape(height, width, 2)


@torch.no_grad()
def distractor_mask(model: DeSplatModel, index: int, camera: Cameras) -> Bool[np.ndarray, "H W"]:
    """Where the distractors of a training view cover its photo, which a camera [1] took, above the
    threshold of all masks (App. C.1)."""
    pinhole, to_photo = pinhole_of(camera)
    drawn = model.draw_distractors(index, model.view_of_camera(pinhole.to(model.device), index))
    if drawn is None:
        return np.zeros((int(camera.height), int(camera.width)), bool)
    return to_photo(drawn.alpha[..., 0].cpu().numpy()) > MASK_THRESHOLD


def dilated(mask: Bool[np.ndarray, "H W"], pixels: float) -> Bool[np.ndarray, "H W"]:
    """All pixels whose centre is at most so many pixels from that of a pixel of the mask."""
    if pixels == 0 or not mask.any():
        return mask
    outside = np.ascontiguousarray(~mask, dtype=np.uint8)
    return cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= pixels
