"""What a trained model shows: training photos taken apart, held-out photos beside renderings.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from desplat_ns.console import progress_over
from desplat_ns.evaluation.pictures import over_checkerboard, to_rgb8
from desplat_ns.files.pages import LARGEST_SIDE, shrunk
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.views import view_of
from desplat_ns.report.views import Unlike, unlike_in
from desplat_ns.scene.gather import Rgb, training_images
from desplat_ns.separation.regions import apply_mask

ERROR_TOP = 0.25
"""Mean difference of the colours, which are in [0, 1], that gets the brightest colour."""


@dataclass(frozen=True)
class TrainingPhoto:
    """A training photo, taken apart; pictures are no larger than a page needs them."""

    name: str
    photo: Rgb
    static: Rgb
    """The static scene in the photo's light."""
    distractors: Rgb | None = None
    """On a chequered ground; this and the next three are None if the effect is off."""
    mask: Rgb | None = None
    covered: float | None = None
    """Share of the photo inside the mask, in [0, 1]."""
    unlike: Unlike | None = None


@dataclass(frozen=True)
class HeldOutPhoto:
    """A photo that was not trained on, and what the static scene shows in its place."""

    name: str
    photo: Rgb
    rendering: Rgb
    error: Rgb
    figures: dict[str, float]


def training_photos(pipeline: DeSplatPipeline, chosen: Sequence[int]) -> Iterator[TrainingPhoto]:
    """Training photos taken apart. Raises CaptureError of a photo that cannot be read any more."""
    model, manager = pipeline.model, pipeline.datamanager
    with (
        model.layer_control.suspended(),
        model.shown_light.suspended(),
        progress_over(len(chosen), "Rendering training photos...") as advance,
    ):
        for index, camera, batch in training_images(manager, chosen):
            camera = camera.to(pipeline.device)
            outputs = model.get_outputs_for_camera(camera)
            photo = model.photo_of(outputs, {"image": batch["image"].to(pipeline.device)})
            name = manager.train_image_names[index]
            static = outputs.get("rgb_static", outputs["rgb"])
            layer: tuple[Any, ...] = ()
            if "alpha_distractor" in outputs:
                alpha_d, seen = outputs["alpha_distractor"], photo
                if "mask" in batch:
                    seen, _ = apply_mask(photo, static, batch["mask"].to(photo.device))
                config = model.config.distractors
                unlike = unlike_in(name, view_of(camera), alpha_d, seen, static, config)
                drawn = (outputs["rgb_distractor"].cpu().numpy(), alpha_d.cpu().numpy())
                drawn = to_rgb8(over_checkerboard(*drawn, max(8, max(photo.shape) // 48)))
                mask = outputs["distractor_mask"].float()
                layer = shrunk(drawn, LARGEST_SIDE), small_rgb(mask), float(mask.mean()), unlike
            yield TrainingPhoto(name, small_rgb(photo), small_rgb(static), *layer)
            advance()


def small_rgb(image: Float[Tensor, "H W _"]) -> Rgb:
    """An image in [0, 1] of one or three channels, as large as a page may need it."""
    return shrunk(to_rgb8(image.detach().cpu().numpy()), LARGEST_SIDE)


def marked(photo: Rgb, where: Bool[np.ndarray, "rows columns"]) -> Rgb:
    """A photo that is dark but where cells of it are set, and in gaps of one cell."""
    closed = cv2.morphologyEx(where.astype(np.float32), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    light = cv2.resize(closed, photo.shape[1::-1], interpolation=cv2.INTER_AREA)
    return (photo * (0.25 + 0.75 * light[..., None])).astype(np.uint8)


def held_out_photos(
    pipeline: DeSplatPipeline, most: int
) -> tuple[dict[str, Any], list[HeldOutPhoto]]:
    """The evaluation that `ns-eval` makes, of all held-out photos, and pictures of the worst, which
    come first: means hide what a look at them shows.

    Args:
        most: pictures; with 0 nothing is evaluated.

    Raises:
        CaptureError: a photo that cannot be read any more.
        DeSplatError: a figure of a photo is not a finite number.
    """
    if most == 0:
        return {}, []
    worst: list[tuple[float, int, Rgb]] = []

    def keep(index: int, pictures: Mapping[str, Tensor]) -> None:
        beside = to_rgb8(pictures["img"].cpu().numpy())
        photo, rendering = np.split(beside.astype(np.float32), 2, axis=1)
        worst.append((-float(np.square(photo - rendering).mean()), index, beside))
        worst.sort(key=lambda entry: entry[:2])
        del worst[most:]  # full pictures of hundreds of photos would be gigabytes

    results, shown = pipeline.evaluate_held_out(keep), []
    for _, index, beside in worst:
        figures = results["images"][index]
        photo, rendering = np.split(beside, 2, axis=1)
        pictures = (photo, rendering, error_map(photo, rendering))
        small = [shrunk(picture, LARGEST_SIDE) for picture in pictures]
        numbers = {key: value for key, value in figures.items() if isinstance(value, float)}
        shown.append(HeldOutPhoto(figures["name"], small[0], small[1], small[2], numbers))
    return results, sorted(shown, key=lambda photo: photo.figures["psnr"])


def error_map(
    photo: UInt8[np.ndarray, "H W 3"], rendering: UInt8[np.ndarray, "H W 3"]
) -> UInt8[np.ndarray, "H W 3"]:
    """Mean absolute difference of the colours, from black over red to pale yellow."""
    difference = np.abs(photo.astype(np.float32) - rendering).mean(axis=2) / ERROR_TOP
    colors = cv2.applyColorMap(difference.clip(0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO)
    return colors[..., ::-1]
