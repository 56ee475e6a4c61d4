"""Are small things in the way found?

python -m lab.separation.small_movers make CAPTURE TARGET --stuff OTHER_CAPTURE [--seed 42]
python -m lab.separation.small_movers train TARGET RESULT.json [--steps 1500] [ns-train's options]
python -m lab.separation.small_movers score RESULT.json ...         (their table, in Markdown)

`train` writes pictures beside its result: photo, static scene, mask, true mask.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import torch

from desplat_ns.data.images import read_image, read_mask, resize_image, resize_mask, write_image
from desplat_ns.studies.records import markdown_table
from desplat_ns.studies.runs import QUIET
from desplat_ns.studies.train_and_score import train_and_score
from lab import parser_of
from lab.separation.passers_by import Mask, ghost, photo_of
from lab.separation.small_things import make

FOUND = 0.3
"""A thing is found if mask and true mask overlap with this IoU within the box around the thing."""

AROUND = 1.0
"""The box reaches this many widths of the thing beyond it on all sides: wide enough that a mask of
everything does not find it."""

NEAR = 5
"""Pixels around a thing within which a mask is not called away from it."""

Result = dict[str, Any]


def truth_of(capture: Path, name: str, thing: Result) -> tuple[Mask, Mask]:
    """In the photo's own size: a thing's mask, and the box around it without other things."""
    left, top, right, bottom = thing["boxes"][name]
    mask = read_mask((capture / "masks" / name).with_suffix(".png"))
    inside, box = np.zeros_like(mask), np.zeros_like(mask)
    inside[top:bottom, left:right] = mask[top:bottom, left:right]
    margin = round(AROUND * (right - left))
    box[max(0, top - margin) : bottom + margin, max(0, left - margin) : right + margin] = True
    return inside, box & (inside | ~mask)


def train(
    capture: Path, steps: int, seed: int, downscale: int, options: list[str], pictures: Path
) -> Result:
    """Train `desplat` with distractors and no other effect; score what it masks."""
    from desplat_ns.pipeline import DeSplatPipeline

    pipelines, init = [], DeSplatPipeline.__init__

    def kept(self: DeSplatPipeline, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        pipelines.append(self)

    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(DeSplatPipeline, "__init__", kept),
    ):
        arguments = ["--data", str(capture), "--output-dir", folder, "--machine.seed", str(seed)]
        arguments += ["--max-num-iterations", str(steps), *QUIET]
        arguments += ["--pipeline.model.effects.auto", "False", *options]
        arguments += ["colmap", "--downscale-factor", str(downscale)]
        run = train_and_score("desplat", arguments, Path(folder) / "held-out")
    wanted = ("psnr", "psnr_worst", "ssim", "num_static_gaussians", "train_cpu_seconds")
    figures = {name: run["figures"].get(name) for name in wanted}
    what = {"capture": capture.name, "steps": steps, "seed": seed, "commit": run["commit"]}
    return {**what, **figures, **scored(pipelines[-1], capture, pictures)}


@torch.no_grad()
def scored(pipeline: Any, capture: Path, pictures: Path) -> Result:
    """Distractor masks of all training photos against the true masks.

    Returns:
        By `false` and `false_away` the mean share of a photo that is masked outside of the things,
        and more than `NEAR` pixels away from them; by `sights` a row for each thing in each photo.
    """
    pipeline.eval()
    things = json.loads((capture / "things.json").read_text())
    dataset, sights, false = pipeline.datamanager.train_dataset, [], []
    for index, name in enumerate(pipeline.datamanager.train_image_names):
        outputs = pipeline.model.get_outputs(dataset.cameras[index : index + 1].to(pipeline.device))
        masked = outputs["distractor_mask"][..., 0].cpu().numpy().astype(bool)
        static, photo = outputs["rgb_static"].cpu().numpy(), photo_of(dataset, index)
        height, width = masked.shape
        truth = np.zeros_like(masked)
        for thing in (thing for thing in things if name in thing["boxes"]):
            mask, box = (resize_mask(m, width, height) for m in truth_of(capture, name, thing))
            clean = read_image(capture / "clean" / name)[..., :3]
            clean = resize_image(clean, width, height) / 255
            truth |= mask
            kept = {key: thing[key] for key in ("id", "kind", "size", "ground", "contrast")}
            kept |= {"photo": name, "photos": len(thing["boxes"]), "iou": iou(masked & box, mask)}
            sights.append(kept | {"ghost": ghost(static[mask], clean[mask], photo[mask])})
        near = cv2.dilate(truth.astype(np.uint8), np.ones((2 * NEAR + 1,) * 2, np.uint8)) > 0
        false.append(((masked & ~truth).mean(), (masked & ~near).mean()))
        gray = [np.repeat(m[..., None], 3, -1).astype(np.float32) for m in (masked, truth)]
        picture = np.concatenate([photo, static, *gray], axis=1)
        write_image((pictures / name).with_suffix(".png"), picture)
    outside, away = np.mean(false, axis=0).tolist()
    return {"false": outside, "false_away": away, "sights": sights}


def iou(a: Mask, b: Mask) -> float:
    """Of two masks; 0 of empty ones."""
    return float((a & b).sum() / max(1, (a | b).sum()))


def report(results: Sequence[Result]) -> str:
    """Markdown: the runs, and their things by kind, size and number of photos."""
    runs = [
        [
            f"{r['capture']}, {r['seed']}, {r['steps']} steps",
            _found(r["sights"]),
            *(f"{100 * r[name]:.2f}%" for name in ("false", "false_away")),
            *(f"{r[name]:.2f}" for name in ("psnr", "psnr_worst")),
        ]
        for r in results
    ]
    head = ["run", "found", "masked outside", "away from things", "PSNR", "worst"]
    groups: dict[tuple[str, str, str], list[Result]] = {}
    every = [sight for result in results for sight in result["sights"]]
    for s in sorted(every, key=lambda s: (s["kind"] != "plain", s["kind"], s["size"], s["photos"])):
        key = (s["kind"], f"{100 * s['size']:g}%", str(s["photos"]))
        groups.setdefault(key, []).append(s)
    groups["all", "", ""] = every
    rows = [
        [*key, _found(sights)]
        + [f"{np.median([s[name] for s in sights]):.2f}" for name in ("iou", "ghost")]
        for key, sights in groups.items()
    ]
    names = ["kind", "size", "photos", "found", "median IoU", "median ghost"]
    return f"{markdown_table(head, runs)}\n\n{markdown_table(names, rows)}"


def _found(sights: Sequence[Result]) -> str:
    return f"{sum(sight['iou'] > FOUND for sight in sights)} of {len(sights)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.separation.small_movers", __doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    made, trained, listed = (commands.add_parser(name) for name in ("make", "train", "score"))
    for command in (made, trained):
        command.add_argument("capture", type=Path)
        command.add_argument("target", type=Path)
        command.add_argument("--seed", type=int, default=42)
    made.add_argument("--stuff", type=Path, required=True, help="a capture that fills the things")
    trained.add_argument("--steps", type=int, default=1500)
    trained.add_argument("--downscale", type=int, default=2)
    listed.add_argument("results", type=Path, nargs="+")
    chosen, options = parser.parse_known_args(arguments)
    if chosen.command == "make":
        make(chosen.capture, chosen.stuff, chosen.target, chosen.seed)
        return
    if chosen.command == "train":
        training = chosen.capture, chosen.steps, chosen.seed, chosen.downscale
        result = train(*training, options, chosen.target.with_suffix(""))
        chosen.target.write_text(json.dumps(result, indent=1))
    files = [chosen.target] if chosen.command == "train" else chosen.results
    print(report([json.loads(path.read_text()) for path in files]))


if __name__ == "__main__":
    main()
