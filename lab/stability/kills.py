"""A run of `ns-train desplat` that is killed again and again, each life a process of its own.

    python -m lab.stability.kills KILLS            prints what became of it as JSON

The lives are forked from one process that has imported and compiled everything, by training a few
steps itself: else each took many seconds to begin.
"""

from __future__ import annotations

import copy
import json
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.scripts import train
from nerfstudio.utils import writer

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.settings.effects import EffectsConfig
from desplat_ns.trainer import DeSplatTrainer
from desplat_ns.training.checkpoint_files import (
    STAGING_FOLDER,
    checkpoints_in,
    load_checkpoint,
    step_of,
)
from lab.synthetic import SceneSpec, write_scene

STEPS, STEPS_PER_SAVE = 240, 2
"""Twice as many as twenty lives come to: where steps take 20 ms, those killed within a second of
their start have trained, too."""
MOST_STEPS = 5
"""A life is killed after 0 to so many of its steps, and up to two steps' time later."""
STARTING = 5
"""Every so many lives are killed before they have trained: while they load."""


@dataclass(frozen=True)
class Kill:
    """One life's end."""

    training: bool
    """Whether it came to train."""
    steps_done: int
    """Steps of the whole run that it, or those before it, had finished."""
    steps_kept: int
    """Steps in the newest checkpoint afterwards."""
    while_saving: bool
    """A checkpoint was half written."""


@dataclass(frozen=True)
class Report:
    """The whole run."""

    steps: int
    steps_per_save: int
    kills: list[Kill]
    damaged: int
    """Checkpoints that could not be loaded, over all lives."""
    most_files: int
    """Checkpoints and half-written ones that lay there at once, at most."""
    same_bits: bool
    """Whether the run ended where an uninterrupted one does."""
    seconds: float


class Telling(DeSplatTrainer):
    """Says through a pipe when training starts, and after each step how many are done."""

    pipe = -1

    def train(self) -> None:
        os.write(self.pipe, b"%d\n" % self._steps_done)
        super().train()

    def train_iteration(self, step: int) -> Any:
        result = super().train_iteration(step)
        os.write(self.pipe, b"%d\n" % self._steps_done)
        return result


class Life:
    """One process that trains a configuration."""

    def __init__(self, config: Any):
        self.out, into = os.pipe()
        self.steps: list[int] = []
        self._rest = b""
        self.process = os.fork()
        if self.process == 0:
            code = 1
            try:
                os.close(self.out)
                Telling.pipe = into
                writer.EVENT_WRITERS.clear()  # the parent's threads did not come along
                train.main(config)
                code = 0
            finally:
                os._exit(code)
        os.close(into)

    def hear(self) -> bool:
        """Take in what was said, waiting for some; False at the end."""
        data = os.read(self.out, 4096)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self.steps += map(int, lines)
        return bool(data)

    def end(self, number: int | None) -> int:
        """Kill it, or wait for its end; its exit status."""
        if number is not None:
            os.kill(self.process, number)
        while self.hear():
            pass
        os.close(self.out)
        return os.waitpid(self.process, 0)[1]


def configured(scene: Path, output: Path, timestamp: str) -> Any:
    """`ns-train desplat` with distractors, refinements from the start, saved often."""
    config: Any = copy.deepcopy(all_methods["desplat"])
    config._target = Telling
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(data=scene)
    config.max_num_iterations, config.vis = STEPS, "tensorboard"
    config.steps_per_eval_image, config.steps_per_eval_all_images = 0, 0
    config.steps_per_save = STEPS_PER_SAVE
    config.output_dir, config.experiment_name, config.timestamp = output, "killed", timestamp
    model = config.pipeline.model
    model.effects = EffectsConfig()
    model.num_downscales, model.schedule_scale = 0, 0.02
    model.distractors = DistractorConfig(per_view=40)
    return config


def resumed(config: Any) -> Any:
    """The same command with `--load-dir`, once there is a checkpoint."""
    config, folder = copy.deepcopy(config), config.get_checkpoint_dir()
    config.load_dir = folder if folder.is_dir() and checkpoints_in(folder) else None
    return config


def kill_once(config: Any, rng: random.Random, starting: bool, step_seconds: float) -> Life:
    """Start or resume the run and kill it at a random moment."""
    life = Life(resumed(config))
    if starting:
        time.sleep(rng.uniform(0, 1))
    else:
        wanted = rng.randint(0, MOST_STEPS)
        while len(life.steps) <= wanted and life.hear():
            pass
        time.sleep(rng.uniform(0, 2 * step_seconds))
    status = life.end(signal.SIGKILL)
    assert os.WIFSIGNALED(status), f"the run ended by itself, with {status}"
    return life


def kill_runs(kills: int, folder: Path, seed: int = 0) -> Report:
    """Train on a generated scene, killed so many times and resumed each time."""
    write_scene(SceneSpec.tiny(), folder / "scene")
    warm_up(configured(folder / "scene", folder, "warm-up"))
    started, rng = time.perf_counter(), random.Random(seed)
    straight = configured(folder / "scene", folder, "straight")
    assert Life(straight).end(None) == 0
    step_seconds = (time.perf_counter() - started) / STEPS
    config = configured(folder / "scene", folder, "killed")
    killed: list[Kill] = []
    damaged, most_files, done = 0, 0, 0
    for i in range(kills):
        life = kill_once(config, rng, i % STARTING == STARTING - 1, step_seconds)
        done = max([done, *life.steps])
        kept, bad = loadable(config.get_checkpoint_dir())
        half = list((config.get_base_dir() / STAGING_FOLDER).glob("*"))
        killed.append(Kill(bool(life.steps), done, kept, bool(half)))
        damaged, done = damaged + bad, kept
        whole = list(config.get_checkpoint_dir().glob("*"))
        most_files = max(most_files, len(whole) + len(half))
    assert Life(resumed(config)).end(None) == 0
    ends = [load_checkpoint(checkpoints_in(c.get_checkpoint_dir())[-1]) for c in (straight, config)]
    seconds = time.perf_counter() - started
    return Report(STEPS, STEPS_PER_SAVE, killed, damaged, most_files, same(*ends), seconds)


def warm_up(config: Any) -> None:
    """Train here: what is imported and compiled on the way is there for all lives."""
    config._target = DeSplatTrainer
    config.max_num_iterations = 15
    train.main(config)


def loadable(folder: Path) -> tuple[int, int]:
    """Steps in the newest checkpoint, and how many checkpoints are damaged; all are tried."""
    newest, bad = 0, 0
    for path in checkpoints_in(folder) if folder.is_dir() else []:
        try:
            assert load_checkpoint(path)["step"] == step_of(path)
            newest = step_of(path) + 1
        except Exception as error:
            bad += 1
            print(error, file=sys.stderr)
    return newest, bad


def same(a: Any, b: Any) -> bool:
    """Equality to the last bit, all the way down."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    return torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b


if __name__ == "__main__":
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as work:
        stdout = os.dup(1)
        os.dup2(2, 1)  # nerfstudio prints; the answer stands alone
        answer = json.dumps(asdict(kill_runs(int(sys.argv[1]), Path(work))))
        os.write(stdout, answer.encode() + b"\n")
