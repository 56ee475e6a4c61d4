"""Measure on a CUDA device what only one can answer; one JSON, one page, in ten minutes.

    python -m lab.gpu            (or: make gpu)

Seven parts: gsplat's kernels; pictures and gradients of each CUDA backend against float64; time of
a training step of nerfstudio's `splatfacto`, `desplat` and `desplat-paper`; the operations that
torch dispatches in one; how often the host waits for the device in one; 1,000 steps of each on a
capture; the tests that need a device. A part that outputs/gpu/gpu.json holds of the same commit and
device is not run again, one that failed is. The page goes to docs/results/gpu.md. Without a CUDA
device the CPU stands in with tiny sizes, which shows that the parts run, and the page goes to
outputs/gpu/; operations are counted there too.
"""

import copy
import json
import math
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.engine.callbacks import TrainingCallbackLocation
from nerfstudio.models import splatfacto
from nerfstudio.scripts.train import _set_random_seed
from PIL import Image
from torch import Tensor
from torch.profiler import ProfilerActivity, profile, record_function

from desplat_ns.backend.gsplat_cuda import GsplatRasterizer
from desplat_ns.backend.registry import compile_kernels
from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.whole import write_whole
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.metrics import psnr, ssim
from desplat_ns.plugin import splatfacto_modules_without_torchmetrics
from desplat_ns.tools.studies.machine import code_version, device_name
from lab import CHECKOUT, DOCS, OUTPUTS, markdown_table, parser_of
from lab.bench.drawing import Drawing, contenders, errors_of
from lab.bench.scenes import make_scene
from lab.machine import describe_machine
from lab.operations import as_on_cuda, operations_of, rasterization, table_of
from lab.synthetic import SceneSpec, write_scene

SECONDS = 570
"""After which no further part begins; compiling gsplat's kernels does not count."""

METHODS = ("splatfacto", "desplat", "desplat-paper")

RUN, LATE = 30_000, 20_000
"""Length of a run, and its step at which steps are timed and waits are counted: all degrees of the
harmonics are in use and nothing is refined, so that all methods draw the same static Gaussians."""

CAPTURE = "fox_cluttered"
"""In the folder that DESPLAT_NS_DATA names."""

WAITS = ("cudaStreamSynchronize", "cudaDeviceSynchronize", "cudaEventSynchronize", "cudaMemcpy")
LAUNCHES = ("cudaLaunchKernel", "cudaLaunchKernelExC", "cuLaunchKernel", "cuLaunchKernelEx")
COUNTED: dict[str, Callable[[str], bool]] = {
    "waits of the host": lambda name: name in WAITS,
    "copies to the device": lambda name: name.startswith("Memcpy HtoD"),
    "copies to the host": lambda name: name.startswith("Memcpy DtoH"),
    "numbers read by the host (item)": lambda name: name == "aten::_local_scalar_dense",
    "lists of indices (nonzero)": lambda name: name == "aten::nonzero",
    "kernels launched": lambda name: name in LAUNCHES,
}
"""Names of the profiler's events, by what is counted."""

TESTS = ("tests/backend", "tests/stability", "tests/test_training_on_a_gpu.py")
"""Where tests are marked `gpu`: collecting all others takes a minute."""

Figures = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """What the parts are told."""

    device: str
    """"cuda", or "cpu" where that stands in."""
    work: Path
    """Folder for captures and runs."""

    @property
    def is_real(self) -> bool:
        """Whether the figures mean anything."""
        return self.device == "cuda"

    def finish(self) -> None:
        """Wait until the device has done all."""
        if self.is_real:
            torch.cuda.synchronize()


def kernels(job: Job) -> Figures:
    """Seconds in which gsplat's kernels are compiled, or loaded where they are."""
    return {"seconds": round(compile_kernels("gsplat", job.device), 1)} if job.is_real else {}


def parity(job: Job) -> Figures:
    """Errors of each backend of the device in float32; the truth is the `torch` backend's drawing
    in float64 on the CPU, with the same limits."""
    rows, runnable = [], contenders()[0]
    torch_cpu = next(c for c in runnable if (c.name, c.device) == ("torch", "cpu"))
    for size in ((2_000, 160, 120), (20_000, 480, 270)) if job.is_real else ((300, 64, 48),):
        scene = make_scene(*size)
        truth = Drawing(torch_cpu, scene, torch.float64).drawn()
        for contender in (c for c in runnable if c.device == job.device):
            errors = errors_of(Drawing(contender, scene).drawn(), truth)
            rows.append({"scene": scene.name, "backend": contender.name, **asdict(errors)})
    return {"rows": rows}


def steps(job: Job) -> Figures:
    """Milliseconds of a training step from its start until the device has finished it; the methods
    take turns, and the first turn is not counted."""
    rows = {}
    sizes = ((100_000, 648, 420), (300_000, 1008, 756)) if job.is_real else ((300, 64, 48),)
    rounds, number = (5, 20) if job.is_real else (2, 2)
    for count, width, height in sizes:
        capture = write_capture(job.work / f"{count}", count, [(width, height)] * 20)
        trainers = {method: trainer_of(job, method, capture) for method in METHODS}
        taken: dict[str, list[float]] = {method: [] for method in METHODS}
        for turn in range(rounds + 1):
            for method, trainer in trainers.items():
                for i in range(number):
                    begun = time.perf_counter()
                    take_step(trainer, LATE + turn * number + i)
                    job.finish()
                    taken[method].append(1e3 * (time.perf_counter() - begun))
        medians = {m: round(statistics.median(ms[number:]), 2) for m, ms in taken.items()}
        rows[f"{count:,} Gaussians, {width} x {height}: step, ms"] = medians
    return rows


def operations(job: Job) -> Figures:
    """Operations of a whole training step, optimizers included; those of each place are printed."""
    capture, row = write_capture(job.work / "operations", 300, [(80, 64)] * 20), {}
    with nullcontext() if job.is_real else as_on_cuda():
        for method in METHODS:
            trainer = trainer_of(job, method, capture)
            if method != "splatfacto":
                trainer.pipeline.model.rasterizer = GsplatRasterizer()
            for i in range(20):  # moments are made, and each photo is looked at
                take_step(trainer, LATE + i)
            places = operations_of(partial(take_step, trainer, LATE + 20))
            print(f"{method}:\n{table_of(places)}", flush=True)
            row[method] = places.total()
    return {"300 Gaussians, 80 x 64: operations per step": row}


def waits(job: Job) -> Figures:
    """Events per training step by torch's profiler, on photos of 20 sizes: each comes once. One of
    the waits in 20 steps is that for the end of the last step."""
    rows: Figures = {f"20 photo sizes, per step: {what}": {} for what in COUNTED}
    count, width, height = (100_000, 648, 420) if job.is_real else (300, 80, 64)
    sizes = [(width - 2 * i, height - i) for i in range(20)]
    capture = write_capture(job.work / "20 sizes", count, sizes)
    activities = [ProfilerActivity.CPU, *[ProfilerActivity.CUDA] * job.is_real]
    for method in METHODS:
        trainer = trainer_of(job, method, capture)
        for i in range(20):
            take_step(trainer, LATE + i)
        job.finish()
        with profile(activities=activities) as profiler, record_function("counted"):
            for i in range(20):
                take_step(trainer, LATE + 20 + i)
            job.finish()
        events = list(profiler.events() or [])
        # The device has a shorter window of the same name on its own time line.
        windows = [event.time_range for event in events if event.name == "counted"]
        window = max(windows, key=lambda span: span.end - span.start)
        names = [e.name for e in events if window.start <= e.time_range.start <= window.end]
        for row, is_one in zip(rows.values(), COUNTED.values(), strict=True):
            row[method] = sum(map(is_one, names)) / 20
    return rows


def training(job: Job) -> Figures:
    """1,000 steps on a real capture, a generated one where that is missing, and the scores."""
    folder, name = Path(os.environ.get("DESPLAT_NS_DATA", ""), CAPTURE), CAPTURE
    if not (job.is_real and folder.is_dir()):
        tiny = SceneSpec(num_views=8, num_extras=2, width=72, height=48, num_points=300)
        folder, name = job.work / "generated", "generated"
        write_scene(SceneSpec() if job.is_real else tiny, folder)
    number, rows = 1_000 if job.is_real else 20, {}
    for method in METHODS:
        trainer = trainer_of(job, method, folder, number)
        _ = trainer.pipeline.datamanager.cached_train  # the first step would read the photos
        begun = time.perf_counter()
        trainer.train()
        job.finish()
        figures = {"seconds": round(time.perf_counter() - begun, 1), **scores_of(trainer.pipeline)}
        for what, figure in figures.items():
            rows.setdefault(f"{name}, {number:,} steps: {what}", {})[method] = figure
    return rows


def scores_of(pipeline: Any) -> dict[str, float]:
    """Means over the held-out photos, and the number of static Gaussians."""
    model = pipeline.eval().model
    pairs = []
    for camera, batch in pipeline.datamanager.fixed_indices_eval_dataloader:
        with torch.no_grad():
            rgb = model.get_outputs_for_camera(camera)["rgb"]
        pairs.append((rgb, model.get_gt_img(batch["image"]).to(rgb)))
    means = {m.__name__: statistics.fmean(m(*pair) for pair in pairs) for m in (psnr, ssim)}
    return {**{name: round(mean, 3) for name, mean in means.items()}, "Gaussians": model.num_points}


def tests(job: Job) -> Figures:
    """pytest's last line, and the names of the tests that failed."""
    if not job.is_real:
        return {}
    command = [sys.executable, "-m", "pytest", "-m", "gpu", "-p", "no:cacheprovider", *TESTS]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, timeout=300)
    failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, flags=re.M)
    return {"summary": done.stdout.strip().splitlines()[-1], "failed": failed}


PARTS: dict[str, Callable[[Job], Figures]] = {
    part.__name__: part for part in (kernels, parity, steps, operations, waits, training, tests)
}


def trainer_of(job: Job, method: str, capture: Path, number: int = RUN) -> Any:
    """nerfstudio's trainer of a registered method for `number` steps on a capture, set up. In runs
    of 1,000 steps photos grow as the method has it; else they have their full size throughout."""
    config: Any = copy.deepcopy(all_methods[method])
    parser = RobustNerfDataParserConfig(data=capture)
    config.pipeline.datamanager.dataparser = parser
    if number == RUN:
        config.pipeline.model.num_downscales = 0
    if method == "desplat":
        config.pipeline.model.effects = EffectsConfig()  # no survey of the capture
    if method != "splatfacto":
        config.accept_mismatch = True  # the photos of `write_capture` are noise
    config.max_num_iterations, config.vis = number, "tensorboard"
    config.machine.device_type, config.output_dir = job.device, job.work / "runs" / capture.name
    config.experiment_name, config.timestamp = method, "run"
    config.steps_per_eval_image = config.steps_per_eval_all_images = 0
    config.steps_per_eval_batch = config.steps_per_save = 0
    _set_random_seed(config.machine.seed)
    with splatfacto_modules_without_torchmetrics():
        trainer = config.setup(local_rank=0, world_size=1)
        trainer.setup()
    trainer.pipeline.train()
    return trainer


def take_step(trainer: Any, step: int) -> None:
    """One whole training step with the callbacks before and after it."""
    for callback in trainer.callbacks:
        callback.run_callback_at_location(step, TrainingCallbackLocation.BEFORE_TRAIN_ITERATION)
    trainer.train_iteration(step)
    for callback in trainer.callbacks:
        callback.run_callback_at_location(step, TrainingCallbackLocation.AFTER_TRAIN_ITERATION)


def write_capture(folder: Path, count: int, sizes: Sequence[tuple[int, int]]) -> Path:
    """A capture in RobustNeRF's layout: `count` points on a wavy wall, seen from an arc by a photo
    of each size (width, height) and by one held-out photo; the photos are smooth noise."""
    rng = np.random.default_rng(0)
    model, images = folder / "sparse" / "0", folder / "images"
    for made in (model, images):
        made.mkdir(parents=True, exist_ok=True)
    width, height = sizes[0]
    across = 1.118 * 3 / (2 * 0.9)  # half the width: a fifth of the points is out of view
    x, y = rng.uniform(-1, 1, (2, count)) * np.array([[across], [across * height / width]])
    names = [f"clutter_{i:04d}.png" for i in range(len(sizes))] + ["extra_0000.png"]
    seen: list[list[int]] = [[] for _ in names]
    with (model / "points3D.txt").open("w") as file:
        for n, z in enumerate(0.1 * np.sin(7 * x) * np.cos(5 * y)):
            track = []
            for photo in (n % len(names), (n + 1) % len(names)):
                track.append(f"{photo + 1} {len(seen[photo])}")
                seen[photo].append(n + 1)
            file.write(f"{n + 1} {x[n]} {y[n]} {z} 128 128 128 0.5 {' '.join(track)}\n")
    cameras, lines = [], []
    for i, (name, (w, h)) in enumerate(zip(names, [*sizes, sizes[0]], strict=True)):
        coarse = Image.fromarray(rng.integers(0, 256, (12, 16, 3), dtype=np.uint8))
        coarse.resize((w, h), Image.Resampling.BICUBIC).save(images / name)
        half = np.radians(20) * (i / len(names) - 0.5)  # of the camera's turn around the wall
        cameras.append(f"{i + 1} PINHOLE {w} {h} {0.9 * width} {0.9 * width} {w / 2} {h / 2}")
        lines.append(f"{i + 1} {math.cos(half)} 0 {math.sin(half)} 0 0 0 3 {i + 1} {name}")
        lines.append(" ".join(f"1 1 {point}" for point in seen[i]))
    (model / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


@contextmanager
def stand_in(job: Job) -> Iterator[None]:
    """Within, nerfstudio's Splatfacto works on the job's device. On the CPU our `numba` backend
    draws where it calls gsplat; on CUDA it is left as it is."""
    if job.is_real:
        yield
        return
    with (
        mock.patch.object(splatfacto, "rasterization", rasterization),
        mock.patch.object(Tensor, "cuda", lambda self, *_, **__: self),
    ):
        yield


def run(job: Job, path: Path) -> Figures:
    """Run the parts that the JSON at `path` does not hold, and write it after each of them."""
    of = {"commit": code_version(), "device": device_name(job.device)}
    record: Figures = {"of": of, "machine": describe_machine(), "parts": {}, "failed": {}}
    if path.exists():
        earlier = json.loads(path.read_text("utf8"))
        record["parts"] = earlier["parts"] if earlier["of"] == of else {}
    begun = time.monotonic()
    for name, part in PARTS.items():
        if name in record["parts"] and part is not kernels:  # each process loads those
            continue
        if time.monotonic() - begun > SECONDS:
            record["failed"][name] = f"not begun: {SECONDS} s are over"
            continue
        print(f"==> {name}", flush=True)
        try:
            record["parts"][name] = part(job)
        except Exception as error:
            traceback.print_exc()
            record["failed"][name] = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
        if part is kernels:
            begun = time.monotonic()
        print(f"==> {name}: done after {time.monotonic() - begun:.0f} s", flush=True)
        write_whole(path, (json.dumps(record, indent=1) + "\n").encode())
    return record


def page(job: Job, record: Figures) -> str:
    """The figures as Markdown: a table by methods, one by backends, and what is missing."""
    parts, machine = record["parts"], record["machine"]
    rows = [
        [what, *(f"{of[method]:,}" if method in of else "" for method in METHODS)]
        for name in ("steps", "operations", "waits", "training")
        for what, of in parts.get(name, {}).items()
    ]
    errors = [
        [f"{row['scene']}, {row['backend']}"]
        + [f"{row[key]:.1e}" for key in ("picture", "gradient")]
        for row in parts.get("parity", {"rows": ()})["rows"]
    ]
    head = ["float32 against float64", "RMSE of colours", "error of gradients"]
    seconds = parts.get("kernels", {}).get("seconds")
    tested = parts.get("tests", {})
    lines = [
        "# On a GPU",
        f"`make gpu` at commit {machine['Commit']}, {machine['Date']}, on {record['of']['device']}"
        f", torch {torch.__version__}, CUDA {torch.version.cuda}, gsplat {machine['gsplat']}.",
        "" if job.is_real else "**The CPU stood in with tiny sizes: the figures mean nothing.**",
        markdown_table(["", *METHODS], rows),
        markdown_table(head, errors),
        f"gsplat's kernels were compiled or loaded in {seconds} s." if seconds else "",
        f"`pytest -m gpu`: {tested['summary']}" if tested else "",
        *(f"- failed: `{name}`" for name in tested.get("failed", ())),
        *(f"- not measured: {name}, {why}" for name, why in record["failed"].items()),
    ]
    return "\n\n".join(filter(None, lines)) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 1 where a part failed or was not begun."""
    parser = parser_of("python -m lab.gpu", __doc__)
    parser.add_argument("--output", type=Path, default=OUTPUTS / "gpu", help="(%(default)s)")
    output: Path = parser.parse_args(arguments).output
    output.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(output / "work", ignore_errors=True)  # of an earlier call
    job = Job("cuda" if torch.cuda.is_available() else "cpu", output / "work")
    if not job.is_real:
        print("torch sees no CUDA device: kernels and tests are skipped, sizes are tiny")
    with stand_in(job):
        record = run(job, output / "gpu.json")
    text = page(job, record)
    print(text)
    write_whole((DOCS / "results" if job.is_real else output) / "gpu.md", text.encode())
    return int(bool(record["failed"]))


if __name__ == "__main__":
    sys.exit(main())
