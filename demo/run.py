"""The demo: make a scene with passers-by in it, train without a GPU, evaluate, draw.

    python demo/run.py            (or: make demo)

Everything it leaves lies in demo/output; start with report.html or sheet.png.
"""

import argparse
import json
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from console import CONSOLE, DemoError, execute, printing_to, shown

from desplat_ns.core.errors import DeSplatError
from desplat_ns.core.pages import Shown, over_checkerboard
from lab.pictures import write_image
from lab.sheet import sheet
from lab.synthetic import Frame, Scene, SceneSpec, write_scene

HERE = Path(__file__).resolve().parent
ROWS = 5
"""Training views on the sheet."""

TITLES = ("photo", "static scene", "truth", "distractors", "their mask", "true mask")

PAGE = "report.html"
"""What `desplat-report` writes about the run."""

MARK = ".made-by-demo"
"""Tells the demo's folders from others, which it must not empty."""


@dataclass(frozen=True)
class Run:
    """One training run, and where its results lie."""

    output: Path
    name: str
    options: tuple[str, ...] = ()

    @property
    def config(self) -> Path:
        return self.output / "training" / self.name / "desplat" / "run" / "config.yml"

    @property
    def metrics(self) -> Path:
        return self.output / (
            "metrics.json" if self.name == "yard" else f"metrics-{self.name}.json"
        )


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=600, help="training steps (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the scene (%(default)s)")
    parser.add_argument("--scene", type=Path, default=HERE / "scene", help="made anew each time")
    parser.add_argument("--output", type=Path, default=HERE / "output", help="made anew each time")
    parser.add_argument("--compare", action="store_true", help="also train without distractors")
    arguments = parser.parse_args()
    if arguments.steps < 1:
        parser.error(f"--steps is {arguments.steps}; give 1 or more")
    return arguments


def start_anew(folder: Path) -> None:
    """Empty a folder of an earlier demo. Raises DemoError where it holds anything else."""
    if folder.is_file():
        raise DemoError(f"{folder} is a file. Name a folder with --scene or --output.")
    if folder.exists() and any(folder.iterdir()) and not (folder / MARK).exists():
        raise DemoError(
            f"{folder} is not empty and was not made by the demo, which would empty it. Name "
            "another folder with --scene or --output, or remove this one."
        )
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    (folder / MARK).touch()


def train_and_evaluate(run: Run, scene: Path, steps: int) -> float:
    """Through `ns-train` and `ns-eval`; returns the seconds that training took."""
    train: list[object] = ["ns-train", "desplat", "--max-num-iterations", steps]
    train += ["--experiment-name", run.name, "--timestamp", "run"]
    train += ["--output-dir", run.output / "training", "--vis", "tensorboard"]
    train += ["--logging.local-writer.max-log-size", 0, *run.options]
    train += ["robustnerf-data", "--data", scene]
    started = time.perf_counter()
    execute(train, run.output / f"train-{run.name}.log", "Training", steps)
    seconds = time.perf_counter() - started
    evaluate = ["ns-eval", "--load-config", run.config, "--output-path", run.metrics]
    execute(evaluate, run.output / f"eval-{run.name}.log", "Evaluating")
    return seconds


def write_page(run: Run) -> None:
    """What `desplat-report` does; here, because another process would take longer to start."""
    from desplat_ns.tools.commands.report import Report

    Report(run.config, output=run.output / PAGE).main()


def draw_views(run: Run, scene: Scene) -> list[tuple[str, list[Shown]]]:
    """Rows of the sheet: training photos, what the trained model makes of them, the truth."""
    from desplat_ns.core.run_files import find_run  # takes seconds: not for `--help`
    from desplat_ns.tools.loading import load_run

    pipeline = load_run(find_run(run.config)).pipeline
    manager: Any = pipeline.datamanager
    cameras = manager.train_dataset.cameras.to(pipeline.device)
    photos = [Path(name).stem for name in manager.train_image_names]
    rows = []
    for view in range(0, len(scene.clutter), -(-len(scene.clutter) // ROWS)):
        photo, clean = scene.clutter[view], scene.clean[view]
        index = photos.index(photo.name)
        rows.append(draw_view(pipeline.model, cameras[index : index + 1], photo, clean))
    return rows


def draw_view(model: Any, camera: Any, photo: Frame, clean: Frame) -> tuple[str, list[Shown]]:
    """One row: a training photo, its layers, and what they should be."""
    outputs = model.get_outputs_for_camera(camera)
    rendered = {key: value.cpu().numpy() for key, value in outputs.items() if value.ndim == 3}
    return photo.name, [
        photo.image,
        rendered["rgb_static"],
        clean.image,
        over_checkerboard(rendered["rgb_distractor"], rendered["alpha_distractor"]),
        rendered["distractor_mask"],
        photo.mask[..., None],
    ]


def summarize(run: Run, plain: Run | None, seconds: float) -> list[str]:
    """What came out, in a few lines."""
    results = json.loads(run.metrics.read_text())["results"]
    lines = [
        f"{results['num_images']} views that were not trained on: PSNR {results['psnr']:.2f} dB, "
        f"SSIM {results['ssim']:.3f}",
        f"masks of {results['num_masks']} training views against the truth: "
        f"IoU {results['mask_iou']:.2f}",
        f"{results['num_static_gaussians']} static Gaussians, "
        f"{results['num_distractor_gaussians']} distractor Gaussians",
        f"trained in {seconds:.0f} s on {results['device']}, backend {results['backend']}",
    ]
    if plain is not None:
        psnr = json.loads(plain.metrics.read_text())["results"]["psnr"]
        lines.insert(1, f"the same without distractor Gaussians: PSNR {psnr:.2f} dB")
    return lines


def report(lines: list[str], run: Run) -> str:
    """Markdown: the figures, the sheet, and what to try next."""
    config = shown(run.config)
    return "\n".join(
        [
            "# DeSplat demo\n",
            *(f"- {line}" for line in lines),
            "\n![training views](sheet.png)\n",
            f"The scene to walk around in, and every photo: [{PAGE}]({PAGE}). "
            "All figures: `metrics.json`. To go on:\n",
            f"    ns-viewer --load-config {config}",
            f"    ns-render dataset --load-config {config} --output-path renders "
            "--rendered-output-names rgb distractor_mask",
            f"    ns-export gaussian-splat --load-config {config} --output-dir export\n",
        ]
    )


def main() -> None:
    arguments = parse_arguments()
    begun = time.perf_counter()
    scene_folder, output = arguments.scene.resolve(), arguments.output.resolve()
    start_anew(scene_folder)
    start_anew(output)
    CONSOLE.print("[bold]1. A scene with passers-by[/bold] (24 photos, 6 more for evaluation)")
    scene = write_scene(SceneSpec(seed=arguments.seed), scene_folder)
    CONSOLE.print(f"{shown(scene_folder)}: {time.perf_counter() - begun:.0f} s")
    CONSOLE.print("[bold]2. Training and evaluation[/bold]")
    run, plain = Run(output, "yard"), None
    seconds = train_and_evaluate(run, scene_folder, arguments.steps)
    if arguments.compare:
        plain = Run(output, "plain", ("--pipeline.model.effects.distractors", "False"))
        train_and_evaluate(plain, scene_folder, arguments.steps)
    CONSOLE.print("[bold]3. Pictures and a page[/bold]")
    with printing_to(output / "draw.log"):
        rows = draw_views(run, scene)
        write_page(run)
    lines = summarize(run, plain, seconds)
    write_image(output / "sheet.png", sheet(rows, TITLES, f"DeSplat, {arguments.steps} steps"))
    (output / "report.md").write_text(report(lines, run))
    CONSOLE.print("[bold]Done[/bold]", f"in {time.perf_counter() - begun:.0f} s:")
    for line in [*lines, f"{shown(output)}: {PAGE}, sheet.png, report.md, metrics.json"]:
        CONSOLE.print(f"  {line}", soft_wrap=True)


if __name__ == "__main__":
    try:
        main()
    except DeSplatError as error:
        sys.exit(f"\nError: {error}")
    except KeyboardInterrupt:
        sys.exit("\nInterrupted.")
