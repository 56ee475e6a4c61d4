"""How often the host waits for the device in a training step, counted by torch's profiler.

Real runs of both methods on the same photos, each with its own trainer: what a trainer, its guards
and its optimizers wait for counts as well.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.engine.trainer import Trainer
from nerfstudio.scripts.train import _set_random_seed
from torch.profiler import ProfilerActivity, profile, record_function

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.nerfstudio_quirks import splatfacto_modules_without_downloads
from lab.gpu.parts.training import capture
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.gpu.stand_in import splatfacto_on

METHODS = ("splatfacto", "desplat")

STEPS, QUICK_STEPS = 400, 12
"""Of a run."""

FIRST, COUNTED = 0.75, 40
"""Which steps are counted: so many from this share of the run on, distractors being in place."""

QUICK_COUNTED = 3

WINDOW = "counted steps"

WAITS = ("cudaStreamSynchronize", "cudaDeviceSynchronize", "cudaEventSynchronize", "cudaMemcpy")
"""Calls in which the host waits until the device has done what it was told."""

COPIES = ("Memcpy DtoH", "Memcpy HtoD")
"""Begin the names of copies between host and device, and of no others."""

OPERATORS = ("aten::_local_scalar_dense", "aten::nonzero")
"""torch's operators whose answer the host has to know: a number, and how many rows there are."""

LAUNCHES = ("cudaLaunchKernel", "cudaLaunchKernelExC", "cuLaunchKernel", "cuLaunchKernelEx")


def measure(job: Job) -> Iterator[Figures]:
    """Events of each method by kind, per step."""
    counts: dict[str, Any] = {}
    for method in METHODS:
        events = profiled(job, method)
        counted = QUICK_COUNTED if job.quick else COUNTED
        counts[method] = per_step(names_within(events), counted)
        yield {"steps": counted, "methods": counts}


def profiled(job: Job, method: str) -> list[Any]:
    """The events of a run whose counted steps are marked by `WINDOW`."""
    steps, counted = (QUICK_STEPS, QUICK_COUNTED) if job.quick else (STEPS, COUNTED)
    config = configuration(job, method, steps)
    _set_random_seed(config.machine.seed)
    with splatfacto_on(job.device), splatfacto_modules_without_downloads():
        trainer = config.setup(local_rank=0, world_size=1)
        trainer.setup()
        watch = Watch(job.device)
        watch.attach(trainer, int(FIRST * steps), counted)
        trainer.train()
    return watch.events


def configuration(job: Job, method: str, steps: int) -> Any:
    """A registered method on the generated capture: nothing else is set than in any other run."""
    config: Any = copy.deepcopy(all_methods[method])
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(data=capture(job))
    config.max_num_iterations, config.vis = steps, "tensorboard"
    config.steps_per_eval_image = config.steps_per_eval_all_images = steps + 1
    config.output_dir = Path(job.work) / "synchronisations"
    config.experiment_name, config.timestamp = method, "run"
    config.machine.device_type = job.device
    if method == "desplat":
        config.pipeline.model.backend = job.backend
    return config


class Watch:
    """Profiles some steps of a run, callbacks included."""

    def __init__(self, device: str) -> None:
        activities = [ProfilerActivity.CPU]
        if device == "cuda":
            activities.append(ProfilerActivity.CUDA)
        self._profile = profile(activities=activities)
        self._window = record_function(WINDOW)
        self._device = device
        self.events: list[Any] = []

    def attach(self, trainer: Trainer, first: int, count: int) -> None:
        """Before all that belongs to a step, and behind it."""
        before, after = (
            TrainingCallback([where], do, iters=(step,))
            for where, do, step in (
                (TrainingCallbackLocation.BEFORE_TRAIN_ITERATION, self._start, first),
                (TrainingCallbackLocation.AFTER_TRAIN_ITERATION, self._stop, first + count - 1),
            )
        )
        trainer.callbacks = [before, *trainer.callbacks, after]

    def _start(self, step: int) -> None:
        self._settle()
        self._profile.__enter__()
        self._window.__enter__()

    def _stop(self, step: int) -> None:
        self._window.__exit__(None, None, None)
        self._settle()
        self._profile.__exit__(None, None, None)
        self.events = list(self._profile.events() or [])

    def _settle(self) -> None:
        if self._device == "cuda":
            torch.cuda.synchronize()


def names_within(events: Iterable[Any]) -> Counter[str]:
    """How often each name begins within the window.

    Raises:
        ValueError: the window is not among the events.
    """
    events = list(events)
    # The profiler also draws the window on the device's own time line: the host's is the longest.
    windows = [event.time_range for event in events if event.name == WINDOW]
    if not windows:
        raise ValueError("The profiler lost the steps that were to be counted.")
    window = max(windows, key=lambda span: span.end - span.start)
    return Counter(
        event.name
        for event in events
        if window.start <= event.time_range.start <= window.end and event.name != WINDOW
    )


def per_step(names: Counter[str], steps: int) -> dict[str, float]:
    """Counts by kind over the number of steps."""
    kinds = {name: names[name] for name in (*WAITS, *OPERATORS)}
    for prefix in COPIES:
        kinds[prefix] = sum(n for name, n in names.items() if name.startswith(prefix))
    kinds["launches"] = sum(names[name] for name in LAUNCHES)
    kinds["waits"] = sum(names[name] for name in WAITS)
    return {kind: round(count / steps, 2) for kind, count in kinds.items()}
