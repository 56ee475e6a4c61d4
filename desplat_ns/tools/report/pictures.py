"""What a trained model shows: training photos taken apart, held-out photos beside renderings.

Letters in shapes: H x W pixels."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from desplat_ns.cameras.near_plane import scene_start
from desplat_ns.core.console import progress_over
from desplat_ns.core.pages import Picture, over_checkerboard, picture_of, to_rgb8
from desplat_ns.tools.report.verdict import detail_kept, shown_anyway
from desplat_ns.training.pipeline import DeSplatPipeline

ERROR_TOP = 0.25
"""Mean difference of the colours, which are in [0, 1], that gets the brightest colour."""
VEILED_DEPTH = 0.5
"""Of the depth at which a view's points start: what is nearer hangs before the camera."""
CARD, BESIDE = 0.8, 0.6
"""Of the pixels' side, what pictures as wide as a card get, and those that are half as wide."""


@dataclass(frozen=True)
class ShownPhoto:
    """A photo, and what is shown of it."""

    name: str
    pictures: dict[str, Picture]
    """By the template's names: `photo`; `rendering`, the static scene in the photo's light; of a
    training photo `distractors`, on a chequered ground, and their `mask`, if there is the effect;
    of a held-out one `error`."""
    covered: float | None = None
    """Share of the photo inside the mask, in [0, 1]."""
    shown_anyway: float = 0.0
    """Share of the mask where the static scene shows what the photo does."""
    figures: Mapping[str, Any] = field(default_factory=dict)
    """Of the evaluation."""


def training_photos(pipeline: DeSplatPipeline, chosen: Sequence[int]) -> Iterator[ShownPhoto]:
    """Training photos taken apart. Raises CaptureError of a photo that cannot be read any more."""
    model, manager = pipeline.model, pipeline.datamanager
    telling = progress_over(len(chosen), "Rendering training photos...")
    with pipeline.static_scene(), telling as advance:
        for index, camera, batch in manager.training_images(chosen):
            camera = camera.to(pipeline.device)
            outputs = model.get_outputs_for_camera(camera)
            photo = model.photo_of(outputs["background"], batch["image"])
            name, covered, anyway = manager.train_image_names[index], None, 0.0
            static = outputs.get("rgb_static", outputs["rgb"])
            pictures = {"photo": picture_of(photo, CARD), "rendering": picture_of(static, CARD)}
            if model.distractors is not None:
                mask = outputs["distractor_mask"].float()
                covered, anyway = float(mask.mean()), shown_anyway(photo, static, mask)
                rgb, alpha = outputs["rgb_distractor"], outputs["alpha_distractor"]
                size = max(8, max(photo.shape) // 48)
                drawn = over_checkerboard(rgb.cpu().numpy(), alpha.cpu().numpy(), size)
                pictures["distractors"] = picture_of(drawn, BESIDE)
                pictures["mask"] = picture_of(mask, BESIDE)
            yield ShownPhoto(name, pictures, covered, anyway)
            advance()


def held_out_photos(
    pipeline: DeSplatPipeline, most: int
) -> tuple[dict[str, Any], list[ShownPhoto]]:
    """The evaluation that `ns-eval` makes, of all held-out photos, and at most so many of them, the
    worst first; with 0 nothing is evaluated. Raises CaptureError of a photo that cannot be read any
    more, DeSplatError where a figure is not finite."""
    if most == 0:
        return {}, []
    worst = list[tuple[float, int, np.ndarray, np.ndarray]]()
    detail: dict[int, float] = {}

    def keep(index: int, beside: Tensor) -> None:
        photo, rendering = np.split(to_rgb8(beside.cpu().numpy()), 2, axis=1)
        error = float(np.square(photo.astype(np.float32) - rendering).mean())
        detail[index] = detail_kept(photo, rendering)
        worst.append((error, index, photo, rendering))
        worst.sort(key=lambda entry: -entry[0])
        del worst[most:]  # full pictures of hundreds of photos would be gigabytes

    pipeline.model.lpips.reason = "a report does without: its network is 230 MB to fetch"
    results, shown = pipeline.evaluate_held_out(keep), []
    for index, image in enumerate(results["images"]):
        image["detail"] = detail[index]
    for _, index, photo, rendering in worst:
        figures = results["images"][index]
        figures |= _gaps(pipeline, index)
        pixels = {"photo": photo, "rendering": rendering, "error": error_map(photo, rendering)}
        pictures = {name: picture_of(each, BESIDE) for name, each in pixels.items()}
        shown.append(ShownPhoto(figures["name"], pictures, figures=figures))
    return results, sorted(shown, key=lambda photo: photo.figures["psnr"])


@torch.no_grad()
def _gaps(pipeline: DeSplatPipeline, index: int) -> dict[str, float]:
    """Shares of a held-out view: `empty`, where nothing of the scene or of a sky is, and `veiled`,
    where something is nearer than `VEILED_DEPTH` of the depth at which the points start."""
    model, dataset = pipeline.model, pipeline.datamanager.eval_dataset
    camera = dataset.cameras[index : index + 1].to(pipeline.device)
    outputs, points = model.get_outputs_for_camera(camera), model.points
    alpha, shares = outputs["accumulation"], {"empty": 0.0, "veiled": 0.0}
    if model.effects.background == "off":
        shares["empty"] = float((alpha < 0.5).float().mean())
    if points is not None:
        near = VEILED_DEPTH * scene_start(points, model.view_of_camera(camera, None))
        shares["veiled"] = float(((outputs["depth"] < near) & (alpha >= 0.5)).float().mean())
    return shares


def error_map(
    photo: UInt8[np.ndarray, "H W 3"], rendering: UInt8[np.ndarray, "H W 3"]
) -> UInt8[np.ndarray, "H W 3"]:
    """Mean absolute difference of the colours, from black over red to pale yellow."""
    difference = np.abs(photo.astype(np.float32) - rendering).mean(axis=2) / ERROR_TOP
    colors = cv2.applyColorMap(difference.clip(0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO)
    return cv2.cvtColor(colors, cv2.COLOR_BGR2RGB)
