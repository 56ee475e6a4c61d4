"""Are small things in the way found, in how many steps, and which rule loses the others?

python -m lab.separation.small_movers make CAPTURE TARGET --stuff OTHER_CAPTURE [--seed 42]
python -m lab.separation.small_movers train TARGET RESULT.json [--steps 1500] [ns-train's options]
python -m lab.separation.small_movers score RESULT.json ...         (their table, in Markdown)

`train` writes pictures beside its result: photo, static scene, mask, truth.
"""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import torch
from torch import Tensor

from desplat_ns.data.images import read_image, read_mask, resize_image, resize_mask, write_image
from desplat_ns.separation.grid import grid_of, pooled
from desplat_ns.separation.layer import DistractorLayer, TrainStep
from desplat_ns.studies.records import markdown_table
from desplat_ns.studies.runs import QUIET
from desplat_ns.studies.train_and_score import train_and_score
from lab.arguments import parser_of
from lab.separation.small_rules import FOUND, iou, judged, lost_by
from lab.separation.small_things import make

AROUND = 1.0
"""The box around a thing has so many of its widths on all sides: wide enough that a mask of
everything does not find it."""

NEAR = 5
"""Pixels around a thing within which a mask is not called away from it."""


# --- what is there -----------------------------------------------------------------------------


@dataclass
class Sight:
    """A thing in one of its photos."""

    capture: Path
    name: str
    thing: dict[str, Any]
    visits: list[dict[str, Any]] = field(default_factory=list)
    sized: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]] = field(
        default_factory=dict
    )

    @cached_property
    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """The thing's mask alone, and the box around it without other things."""
        left, top, right, bottom = self.thing["boxes"][self.name]
        mask = read_mask((self.capture / "masks" / self.name).with_suffix(".png"))
        inside, box = np.zeros_like(mask), np.zeros_like(mask)
        inside[top:bottom, left:right] = mask[top:bottom, left:right]
        margin = round(AROUND * (right - left))
        box[max(0, top - margin) : bottom + margin, max(0, left - margin) : right + margin] = True
        return inside, box & (inside | ~mask)

    def at(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mask, box and the clean photo in cells of `grid_of` such a photo."""
        if (width, height) not in self.sized:
            mask, box = (resize_mask(part, *grid_of(width, height)) for part in self.truth)
            clean = read_image(self.capture / "clean" / self.name)[..., :3]
            clean = resize_image(resize_image(clean, width, height), *grid_of(width, height))
            self.sized[width, height] = mask, box, clean / 255.0
        return self.sized[width, height]

    def ghost(self, static: Tensor, photo: Tensor) -> float:
        """How far the static scene shows the thing: 0 where it is as the clean photo, 1 where it
        is as the photo with the thing."""
        height, width = photo.shape[:2]
        mask, _, clean = self.at(width, height)
        cells = (pooled(image, grid_of(width, height)) for image in (static, photo))
        shown, there = (image.permute(1, 2, 0).numpy()[mask] - clean[mask] for image in cells)
        return float((shown * there).sum() / max(1e-9, (there * there).sum()))


def sights_of(capture: Path) -> dict[str, list[Sight]]:
    """The things of a capture, by the names of photos."""
    sights: dict[str, list[Sight]] = {}
    for thing in json.loads((capture / "things.json").read_text()):
        for name in thing["boxes"]:
            sights.setdefault(name, []).append(Sight(capture, name, thing))
    return sights


# --- training ------------------------------------------------------------------------------------


@contextmanager
def recorded(sights: dict[str, list[Sight]], names: Callable[[], list[str]]) -> Iterator[None]:
    """Notes after each visit to a photo what the rules say of its things; `names` of the training
    photos are asked for once there are any."""
    step, commit = 0, DistractorLayer.commit

    def noting(self: DistractorLayer, train_step: TrainStep, params: Any, memory: Any, *rest: Any):
        nonlocal step
        step += 1
        here = sights.get(names()[train_step.index], [])
        if here and train_step.regions is not None:
            said, (height, width) = (
                judged(self, train_step, params, memory),
                train_step.photo.shape[:2],
            )
            for sight in here:
                cells, box, _ = sight.at(width, height)
                ghost = sight.ghost(train_step.static_rgb.detach(), train_step.photo)
                shares = {
                    "iou": iou(said.regions & box, cells),
                    "excess": said.excess[cells].max(),
                    "evidence": said.evidence[cells].max(),
                    "known": said.is_known[cells].mean(),
                    "weak": said.is_weak[cells].mean(),
                    "foreign": said.is_foreign[cells].mean(),
                    "votes": said.has_votes[cells].mean(),
                    "ghost": ghost,
                }
                rule = lost_by(said, cells, box, ghost)
                rounded = {name: round(float(share), 2) for name, share in shares.items()}
                sight.visits.append({"step": step, "rule": rule, **rounded})
        return commit(self, train_step, params, memory, *rest)

    with patch.object(DistractorLayer, "commit", noting):
        yield


def train(capture: Path, steps: int, seed: int, downscale: int, options: list[str], pictures: Path):
    """Train `desplat` with distractors and nothing else, and score what it masks."""
    from desplat_ns.pipeline import DeSplatPipeline

    sights, pipelines, init = sights_of(capture), [], DeSplatPipeline.__init__

    def kept(self: DeSplatPipeline, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        pipelines.append(self)

    def names() -> list[str]:
        return pipelines[-1].datamanager.train_image_names

    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(DeSplatPipeline, "__init__", kept),
        recorded(sights, names),
    ):
        arguments = ["--data", str(capture), "--output-dir", folder, "--machine.seed", str(seed)]
        arguments += ["--max-num-iterations", str(steps), *QUIET]
        arguments += ["--pipeline.model.effects.auto", "False", *options]
        arguments += ["colmap", "--downscale-factor", str(downscale)]
        run = train_and_score("desplat", arguments, Path(folder) / "held-out")
    wanted = ("psnr", "psnr_worst", "ssim", "num_static_gaussians", "train_cpu_seconds")
    figures = {name: run["figures"].get(name) for name in wanted}
    what = {"capture": capture.name, "steps": steps, "seed": seed, "commit": run["commit"]}
    return {**what, **figures, **_scored(pipelines[-1], sights, steps, pictures)}


@torch.no_grad()
def _scored(
    pipeline: Any, sights: dict[str, list[Sight]], steps: int, pictures: Path
) -> dict[str, Any]:
    """Masks of all training photos against the truth."""
    pipeline.eval()
    dataset, results, outside = pipeline.datamanager.train_dataset, [], []
    for index, name in enumerate(pipeline.datamanager.train_image_names):
        outputs = pipeline.model.get_outputs(dataset.cameras[index : index + 1].to(pipeline.device))
        masked = outputs["distractor_mask"][..., 0].cpu().numpy().astype(bool)
        height, width = masked.shape
        truth = np.zeros_like(masked)
        for sight in sights.get(name, []):
            mask, box = (resize_mask(part, width, height) for part in sight.truth)
            truth |= mask
            results.append(_result(sight, masked & box, mask, steps))
        near = cv2.dilate(truth.astype(np.uint8), np.ones((2 * NEAR + 1,) * 2, np.uint8)) > 0
        outside.append((name, (masked & ~truth).mean(), (masked & ~near).mean()))
        image = dataset[index]["image"][..., :3]
        photo = (image.float() / 255 if image.dtype == torch.uint8 else image).numpy()
        parts = [photo, outputs["rgb_static"].cpu().numpy()]
        parts += [np.repeat(m[..., None], 3, -1).astype(np.float32) for m in (masked, truth)]
        write_image((pictures / name).with_suffix(".png"), np.concatenate(parts, axis=1))
    worst = sorted(outside, key=lambda part: -part[2])[:5]
    return {
        "false": float(np.mean([part[1] for part in outside])),
        "false_away": float(np.mean([part[2] for part in outside])),
        "false_worst": {name: round(float(share), 4) for name, _, share in worst},
        "sights": results,
    }


def _result(sight: Sight, masked: np.ndarray, mask: np.ndarray, steps: int) -> dict[str, Any]:
    """A thing in a photo: whether it is masked in the end, and what became of it on the way."""
    thing, visits = sight.thing, sight.visits
    first = next((visit["step"] for visit in visits if visit["rule"] == "found"), None)
    middle = min(visits, key=lambda v: abs(v["step"] - steps / 2), default={"rule": "no visit"})
    last = visits[-1]["rule"] if visits else "no visit"
    overlap = iou(masked, mask)
    kept = {key: thing[key] for key in ("id", "kind", "size", "ground", "contrast")}
    return kept | {
        "photo": sight.name,
        "photos": len(thing["boxes"]),
        "iou": round(overlap, 3),
        "recall": round(float((masked & mask).sum() / max(1, mask.sum())), 3),
        "ghost": visits[-1]["ghost"] if visits else None,
        "first_found": first,
        "lost_by": None if overlap > FOUND else "not enough steps" if last == "found" else last,
        "middle": middle["rule"],
        "visits": visits,
    }


# --- the table ---------------------------------------------------------------------------------


def report(results: Sequence[dict[str, Any]]) -> str:
    """Markdown: the runs, and their things by kind, size and number of photos."""
    runs = [
        [
            f"{r['capture']}, {r['seed']}, {r['steps']} steps",
            f"{sum(s['iou'] > FOUND for s in r['sights'])} of {len(r['sights'])}",
            *(f"{100 * r[name]:.2f}%" for name in ("false", "false_away")),
            *(f"{r[name]:.2f}" for name in ("psnr", "psnr_worst")),
        ]
        for r in results
    ]
    head = ["run", "found", "masked outside", "away from things", "PSNR", "worst"]
    groups: dict[tuple[str, float, int], list[dict[str, Any]]] = {}
    for sight in (sight for result in results for sight in result["sights"]):
        groups.setdefault((sight["kind"], sight["size"], sight["photos"]), []).append(sight)
    rows = [_row(key, groups[key]) for key in sorted(groups, key=lambda k: (k[0] != "plain", k))]
    rows.append(_row(("all", None, None), [sight for group in groups.values() for sight in group]))
    names = ["kind", "size", "photos", "found", "median IoU", "ghost", "first found", "lost by"]
    return f"{markdown_table(head, runs)}\n\n{markdown_table(names, rows)}"


def _row(key: tuple[str, float | None, int | None], sights: list[dict[str, Any]]) -> list[str]:
    kind, size, photos = key
    first = [sight["first_found"] for sight in sights if sight["first_found"] is not None]
    lost = Counter(sight["lost_by"] for sight in sights if sight["lost_by"] is not None)
    ghosts = [sight["ghost"] for sight in sights if sight["ghost"] is not None]
    return [
        kind,
        "" if size is None else f"{100 * size:g}%",
        "" if photos is None else str(photos),
        f"{sum(sight['iou'] > FOUND for sight in sights)} of {len(sights)}",
        f"{np.median([sight['iou'] for sight in sights]):.2f}",
        f"{np.median(ghosts):.2f}" if ghosts else "",
        f"{np.median(first):.0f}" if first else "",
        ", ".join(f"{name} {count}" for name, count in lost.most_common()),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.separation.small_movers", __doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    made, trained, scored = (commands.add_parser(name) for name in ("make", "train", "score"))
    for command in (made, trained):
        command.add_argument("capture", type=Path)
        command.add_argument("target", type=Path)
        command.add_argument("--seed", type=int, default=42)
    made.add_argument("--stuff", type=Path, required=True, help="a capture that fills the things")
    trained.add_argument("--steps", type=int, default=1500)
    trained.add_argument("--downscale", type=int, default=2)
    scored.add_argument("results", type=Path, nargs="+")
    chosen, options = parser.parse_known_args(arguments)
    if chosen.command == "make":
        make(chosen.capture, chosen.stuff, chosen.target, chosen.seed)
    elif chosen.command == "train":
        pictures = chosen.target.with_suffix("")
        result = train(
            chosen.capture, chosen.steps, chosen.seed, chosen.downscale, options, pictures
        )
        chosen.target.write_text(json.dumps(result, indent=1))
        print(report([result]))
    else:
        print(report([json.loads(path.read_text()) for path in chosen.results]))


if __name__ == "__main__":
    main()
