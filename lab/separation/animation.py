"""Training photos one after another, beside the static scene and what was found in the way.

python -m lab.separation.animation CONFIG     (config.yml of a run of desplat)
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from desplat_ns.evaluation.pictures import to_rgb8
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run
from lab.documents import DOCS
from lab.sheet import sheet

OUTPUTS = {"photo": "", "static scene": "rgb_static", "in the way": "distractor_mask"}
"""What is shown, and the model's output that it is; the photo is none."""

MILLISECONDS = 700
"""Of a photo."""


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m lab.separation.animation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("config", type=Path)
    parser.add_argument("--width", type=int, default=240, help="of a picture (%(default)s)")
    parser.add_argument("--most", type=int, default=20, help="photos, evenly (%(default)s)")
    parser.add_argument("--output", type=Path, default=DOCS / "separation.webp")
    return parser.parse_args()


def frames(pipeline: Any, width: int, most: int) -> list[Image.Image]:
    """A sheet for each of `most` training photos, evenly chosen, in pictures of that width."""
    manager = pipeline.datamanager
    names, dataset = manager.train_image_names, manager.train_dataset
    drawn = []
    for index in np.unique(np.linspace(0, len(names) - 1, most).round().astype(int)):
        camera = dataset.cameras[index : index + 1].to(pipeline.device)
        camera.metadata = {"train_idx": torch.tensor([[index]])}
        with torch.no_grad():
            outputs = pipeline.model.get_outputs(camera)
        outputs[""] = dataset[index]["image"]
        pictures = [to_rgb8(outputs[output].cpu().numpy()) for output in OUTPUTS.values()]
        size = (width, round(width * len(pictures[0]) / pictures[0].shape[1]))
        smaller = [np.asarray(Image.fromarray(picture).resize(size)) for picture in pictures]
        drawn.append(Image.fromarray(sheet([(names[index], smaller)], list(OUTPUTS))))
    return drawn


def main() -> None:
    """Entry point."""
    chosen = parse_arguments()
    pipeline: Any = load_run(find_run(chosen.config)).pipeline
    pipeline.model.eval()
    first, *others = frames(pipeline, chosen.width, chosen.most)
    first.save(
        chosen.output,
        save_all=True,
        append_images=others,
        duration=MILLISECONDS,
        loop=0,
        quality=70,
        method=6,
    )
    print(f"{chosen.output}: {chosen.output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
