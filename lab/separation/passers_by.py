"""How well runs on the photos of the bronze family tell its passers-by from what stands still.

python -m lab.separation.passers_by RUN/config.yml [more] --output FOLDER   (writes scores.json)

For each training photo: the distractor mask against the polygons of `lab.separation.family`, the
share of what stands still that is masked, and how much of the passers-by the static scene shows
(`ghost`), compared with what other photos show at these places. All runs are compared at the same
pixels: those photos are warped by the static depth of the reference, the first run unless another
is named. Give one that has no ghosts of its own: where it has, its depth is wrong, the other photos
contradict it, and the pixels are left out (`seen` says how many are not).

Letters in shapes: H x W pixels at the size of training, P pixels of them, C colours.
"""

import json
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image

from desplat_ns.cameras.views import world_to_camera
from desplat_ns.core.pages import to_rgb8
from desplat_ns.core.run_files import find_run
from desplat_ns.tools.loading import load_run
from lab import parser_of
from lab.separation import family
from lab.sheet import sheet

Mask = Bool[np.ndarray, "H W"]
Picture = Float[np.ndarray, "H W 3"]
Scores = dict[str, Any]
Pixels = dict[str, np.ndarray]
"""Of one photo or several: values [P, C] and masks [P], by what they are."""

TOLERANCE = 0.1
"""Depths of two views that differ by a smaller share are of the same surface. After 1,500 steps
0.05, 0.1 and 0.2 compare 44%, 65% and 82% of the passers-by, all with a ghost of 0.08."""

FEWEST = 2
"""Other photos that have to see a pixel: one alone may see something else that is not the scene."""

RING = 8
"""Pixels around the polygons, where the warped photos are compared with the photo itself."""

SATURATED = 0.98
"""Of 1. From there on a colour says nothing about exposure."""


@dataclass(frozen=True)
class Frame:
    """A training photo and what a run draws of it."""

    name: str
    photo: Picture
    static: Picture
    depth: Float[np.ndarray, "H W"]
    """Along the view's axis, world units."""
    masked: Mask
    intrinsics: Float[np.ndarray, "3 3"]
    world_to_camera: Float[np.ndarray, "4 4"]

    @property
    def passers(self) -> Mask:
        return family.masks(self.name, *self.masked.shape[::-1])

    @property
    def unsure(self) -> Mask:
        return family.unsure(self.name, *self.masked.shape[::-1])

    @property
    def still(self) -> dict[str, Mask]:
        return family.still(self.name, *self.masked.shape[::-1])


def ghost(
    static: Float[np.ndarray, "P C"],
    truth: Float[np.ndarray, "P C"],
    photo: Float[np.ndarray, "P C"],
) -> float:
    """How much of what passes is left in the static scene: 0 none, 1 all of it.

    The coefficient of photo - truth in static - truth, by least squares; NaN where the photo shows
    the truth and there is nothing to leave.
    """
    passing = photo - truth
    power = float((passing**2).sum())
    return float(((static - truth) * passing).sum()) / power if power > 0 else float("nan")


def photo_of(dataset: Any, index: int) -> Picture:
    """A photo of nerfstudio's dataset, float32 in [0, 1]."""
    photo = dataset[index]["image"].numpy()[..., :3]
    return photo.astype(np.float32) / 255 if photo.dtype == np.uint8 else photo


@torch.no_grad()
def frames_of(pipeline: Any) -> list[Frame]:
    """The training photos of a run, with its static scene and its masks."""
    manager, frames = pipeline.datamanager, []
    for index, name in enumerate(manager.train_image_names):
        camera = manager.train_dataset.cameras[index : index + 1].to(pipeline.device)
        camera.metadata = {"train_idx": torch.tensor([[index]])}
        drawn = {key: out.cpu().numpy() for key, out in pipeline.model.get_outputs(camera).items()}
        depth = drawn["depth"][..., 0]
        frames.append(
            Frame(
                PurePath(name).stem,
                photo_of(manager.train_dataset, index),
                drawn["rgb"],
                depth,
                drawn.get("distractor_mask", np.zeros((*depth.shape, 1), bool))[..., 0],
                camera.get_intrinsics_matrices()[0].cpu().numpy(),
                world_to_camera(camera.camera_to_worlds[0].cpu()).numpy(),
            )
        )
    return frames


def warped(frame: Frame, other: Frame) -> Picture:
    """What another photo shows at the static surface of each pixel, in its own exposure; NaN where
    the surface is hidden there, outside of the image, or covered by what passes."""
    height, width = frame.depth.shape
    v, u = np.indices((height, width)) + 0.5
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(frame.intrinsics).T
    points = np.concatenate([rays * frame.depth[..., None], np.ones((height, width, 1))], -1)
    seen = points @ (other.world_to_camera @ np.linalg.inv(frame.world_to_camera)).T
    z = seen[..., 2]
    pixel = seen[..., :3] @ other.intrinsics.T / np.where(z > 0, z, 1)[..., None] - 0.5
    x, y = (pixel[..., axis].astype(np.float32) for axis in (0, 1))
    depth = cv2.remap(other.depth, x, y, cv2.INTER_NEAREST, borderValue=(0.0,))
    covered = (other.passers | other.unsure).astype(np.uint8)
    free = cv2.remap(covered, x, y, cv2.INTER_NEAREST, borderValue=(1.0,)) == 0
    visible = free & (z > 0) & (np.abs(depth - z) < TOLERANCE * z)
    colors = cv2.remap(other.photo, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(visible[..., None], colors, np.nan)


def truth_of(frame: Frame, frames: list[Frame]) -> Picture:
    """The scene behind the passers-by and around them: the median of the photos that see it, each
    brought to this photo's exposure by a gain per channel; NaN elsewhere."""
    where = _grown(frame.passers)
    fit = ~(frame.passers | frame.unsure)
    stack = []
    for other in frames:
        colors = warped(frame, other)
        if other.name == frame.name or np.isnan(colors[where]).all():
            continue
        ratio = np.where((colors > 0.02) & (colors < SATURATED), frame.photo / colors, np.nan)
        ratio = ratio[fit & (frame.photo < SATURATED).all(-1)]
        if np.isfinite(ratio).any(0).all():
            stack.append(colors[where] * np.nanmedian(ratio, 0))
    truth = np.full_like(frame.photo, np.nan)
    if len(stack) >= FEWEST:
        views = np.clip(np.stack(stack), 0, 1)
        enough = np.isfinite(views[..., 0]).sum(0) >= FEWEST
        found = np.full(views.shape[1:], np.nan, np.float32)
        found[enough] = np.nanmedian(views[:, enough], 0)
        truth[where] = found
    return truth


def _grown(mask: Mask) -> Mask:
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RING + 1,) * 2)
    return cv2.dilate(mask.astype(np.uint8), disk) > 0


def scores_of(frames: list[Frame], truths: dict[str, Picture]) -> Scores:
    """All figures: of each photo (`frames`), and pooled over the pixels of the photos that show a
    passer-by; what is masked outside of the polygons over all photos. Unsure pixels are left out.
    """
    rows = {frame.name: _pixels(frame, truths[frame.name]) for frame in frames}
    everywhere = _figures(_pooled(list(rows.values())))
    scores = _figures(_pooled([row for row in rows.values() if row["passer"].any()]))
    scores |= {key: everywhere[key] for key in ("masked_outside", "masked_still")}
    return scores | {"frames": {name: _figures(row) for name, row in rows.items()}}


def _pixels(frame: Frame, truth: Picture) -> Pixels:
    """What is scored of one photo, pixel by pixel, without those that are unsure."""
    row = {"static": frame.static, "photo": frame.photo, "truth": truth, "masked": frame.masked}
    row |= {"passer": frame.passers, "near": _grown(frame.passers)}
    nowhere = np.zeros_like(frame.masked)
    row |= {kind: frame.still.get(kind, nowhere) for kind in family.STILL}
    return {key: array[~frame.unsure] for key, array in row.items()}


def _pooled(rows: list[Pixels]) -> Pixels:
    return {key: np.concatenate([row[key] for row in rows]) for key in rows[0]}


def _figures(row: Pixels) -> Scores:
    masked, passer = row["masked"], row["passer"]
    known = np.isfinite(row["truth"]).all(-1)
    inside, ring = passer & known, row["near"] & ~passer & known
    static, truth, photo = (row[key][inside] for key in ("static", "truth", "photo"))
    around = np.abs(row["photo"] - row["truth"])[ring]
    still = {kind: _share(masked, row[kind]) for kind in family.STILL if row[kind].any()}
    return {
        "iou": _share(masked & passer, masked | passer) if passer.any() else None,
        "recall": _share(masked, passer),
        "masked_outside": _share(masked, ~passer),
        "masked_still": still,
        "passer_pixels": int(passer.sum()),
        "seen": _share(known, passer),
        "ghost": ghost(static, truth, photo) if inside.any() else None,
        "static_error": float(np.abs(static - truth).mean()) if inside.any() else None,
        "truth_error_around": float(around.mean()) if ring.any() else None,
    }


def _share(of: Mask, among: Mask) -> float | None:
    return float((of & among).sum() / among.sum()) if among.any() else None


def draw(frames: list[Frame], truths: dict[str, Picture], folder: Path) -> None:
    """A sheet for each photo: passers-by outlined in red, what is unsure in blue; magenta where no
    other photo says what is behind."""
    folder.mkdir(parents=True, exist_ok=True)
    titles = ("photo", "static scene", "other photos", "distractor mask", "|static - photo| x 3")
    for frame in frames:
        outlined = to_rgb8(frame.photo).copy()
        for mask, color in ((frame.passers, (255, 0, 0)), (frame.unsure, (0, 0, 255))):
            found, _ = cv2.findContours(
                mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
            )
            cv2.drawContours(outlined, found, -1, color, 1)
        others = np.where(frame.passers[..., None], truths[frame.name], frame.photo)
        difference = 3 * np.abs(frame.static - frame.photo)
        row = (outlined, frame.static, others, frame.masked[..., None], difference)
        Image.fromarray(sheet([(frame.name, row)], titles)).save(folder / f"{frame.name}.jpg")


def main() -> None:
    """Score the runs, print a line for each, write scores.json and the sheets."""
    parser = parser_of("python -m lab.separation.passers_by", __doc__)
    parser.add_argument("config", type=Path, nargs="+", help="config.yml of a run")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--reference", type=Path, help="the run whose depth warps (the first)")
    chosen = parser.parse_args()
    reference = frames_of(load_run(find_run(chosen.reference or chosen.config[0])).pipeline)
    truths = {frame.name: truth_of(frame, reference) for frame in reference}
    results = {}
    for number, config in enumerate(chosen.config):
        pipeline = load_run(find_run(config)).pipeline
        frames = frames_of(pipeline)
        scores = scores_of(frames, truths)
        held_out = pipeline.evaluate_held_out(lambda index, beside: None)
        scores |= {key: held_out[key] for key in ("psnr", "ssim")}
        results[str(config)] = scores
        draw(frames, truths, chosen.output / str(number))
        shown = {key: value for key, value in scores.items() if key != "frames"}
        print(config, json.dumps(shown, indent=1), sep="\n")
    (chosen.output / "scores.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
