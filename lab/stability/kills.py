"""A run of `ns-train desplat` that is killed again and again, each life a process of its own.

    python -m lab.stability.kills            prints what became of it as JSON

The lives are forked from one process that has imported and compiled everything by training a few
steps itself; without that each life would take many seconds to begin.
"""

import copy
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.scripts import train
from nerfstudio.utils import writer
from torch.utils._pytree import tree_flatten

from desplat_ns.core.checkpoint import (
    STAGING_FOLDER,
    checkpoints_in,
    load_checkpoint,
    step_of,
)
from desplat_ns.core.effects import EffectsConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.training.trainer import DeSplatTrainer
from lab import CHECKOUT
from lab.synthetic import SceneSpec, write_scene

KILLS = 20
STEPS, STEPS_PER_SAVE = 240, 2
"""Twice the steps that twenty lives take, so that the last life is killed in training as well."""
MOST_STEPS = 5
"""A life is killed after 0 to 5 of its steps, and up to two steps' time later."""
STARTING = 5
"""Every fifth life is killed before it has trained, while it loads."""
MOST_FILES = 4
"""Checkpoints that may lie in a run's folder: the newest, the one before, one that a kill between
saving and clearing away left there, and one half written."""


class Telling(DeSplatTrainer):
    """Says through a pipe when training starts, and after each step how many steps are done."""

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
        """Kill it with a signal, or wait for its end; its exit status."""
        if number is not None:
            os.kill(self.process, number)
        while self.hear():
            pass
        os.close(self.out)
        return os.waitpid(self.process, 0)[1]


def configured(scene: Path, output: Path, timestamp: str, trainer: type) -> Any:
    """`ns-train desplat` on a scene of `SceneSpec.tiny`, without a survey and evaluations."""
    config: Any = copy.deepcopy(all_methods["desplat"])
    config._target, config.vis = trainer, "tensorboard"
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(data=scene)
    config.steps_per_eval_image = config.steps_per_eval_all_images = 0
    config.output_dir, config.experiment_name, config.timestamp = output, "stability", timestamp
    model = config.pipeline.model
    model.effects, model.num_downscales, model.distractors.per_view = EffectsConfig(), 0, 40
    return config


def saved_often(scene: Path, output: Path, timestamp: str, trainer: type = Telling) -> Any:
    """The same with distractors and refinements from the first steps on."""
    config = configured(scene, output, timestamp, trainer)
    config.max_num_iterations, config.steps_per_save = STEPS, STEPS_PER_SAVE
    config.pipeline.model.schedule_scale = 0.02
    config.pipeline.model.distractors = DistractorConfig(per_view=40)
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


def kill_runs(kills: int, folder: Path, seed: int = 0) -> dict[str, Any]:
    """Train on a generated scene, killed `kills` times and resumed each time.

    Returns:
        By `kills` for each life whether it has trained, the steps of the whole run that it or those
        before it had finished, and the steps in the newest checkpoint afterwards; by `damaged` the
        number of checkpoints that could not be loaded; by `most_files` how many checkpoints and
        half-written ones lay in the run's folder at once; by `same_bits` whether the run ended
        where an uninterrupted one does.
    """
    write_scene(SceneSpec.tiny(), folder / "scene")
    warm_up = saved_often(folder / "scene", folder, "warm-up", DeSplatTrainer)
    warm_up.max_num_iterations = 15
    train.main(warm_up)
    started, rng = time.perf_counter(), random.Random(seed)
    straight = saved_often(folder / "scene", folder, "straight")
    assert Life(straight).end(None) == 0
    step_seconds = (time.perf_counter() - started) / STEPS
    config = saved_often(folder / "scene", folder, "killed")
    killed: list[tuple[bool, int, int]] = []
    damaged, most_files, done = 0, 0, 0
    for i in range(kills):
        life = kill_once(config, rng, i % STARTING == STARTING - 1, step_seconds)
        done = max([done, *life.steps])
        kept, bad = loadable(config.get_checkpoint_dir())
        killed.append((bool(life.steps), done, kept))
        damaged, done = damaged + bad, kept
        half = list((config.get_base_dir() / STAGING_FOLDER).glob("*"))
        whole = list(config.get_checkpoint_dir().glob("*"))
        most_files = max(most_files, len(whole) + len(half))
    assert Life(resumed(config)).end(None) == 0
    ends = [load_checkpoint(checkpoints_in(c.get_checkpoint_dir())[-1]) for c in (straight, config)]
    found = {"kills": killed, "damaged": damaged, "most_files": most_files}
    return {**found, "same_bits": same(*ends)}


def loadable(folder: Path) -> tuple[int, int]:
    """Steps in the newest checkpoint, and the number of damaged checkpoints; all are tried."""
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
    """Equality of nested dicts and lists of tensors to the last bit."""
    (ours, our_tree), (theirs, their_tree) = tree_flatten(a), tree_flatten(b)
    pairs = zip(ours, theirs, strict=False)
    equal = (torch.equal(x, y) if isinstance(x, torch.Tensor) else x == y for x, y in pairs)
    return our_tree == their_tree and all(equal)


def verdict(found: dict[str, Any]) -> tuple[str, bool]:
    """A sentence on what kills cost, and whether that is what is promised."""
    lost = [done - kept for _, done, kept in found["kills"]]
    text = (
        f"{len(lost)} kills of a run of {STEPS} steps that saves every {STEPS_PER_SAVE} lost "
        f"{max(lost)} steps at most and {sum(lost)} in all; {found['damaged']} checkpoints were "
        f"damaged, {found['most_files']} lay in the folder at most, and the run ended "
        f"{'to the last bit' if found['same_bits'] else 'NOT'} where an uninterrupted one ends."
    )
    # the first save, after step number STEPS_PER_SAVE of 0, 1, ..., has one step more before it
    most = [STEPS_PER_SAVE + (kept == 0) for _, _, kept in found["kills"]]
    is_kept = all(0 <= steps <= bound for steps, bound in zip(lost, most, strict=True))
    is_kept = is_kept and found["most_files"] <= MOST_FILES
    has_trained = sum(trained for trained, *_ in found["kills"]) >= len(lost) // 2
    return text, is_kept and has_trained and found["damaged"] == 0 and found["same_bits"]


def measured() -> tuple[str, bool]:
    """As `verdict`, of 20 kills: in a process of its own on one thread, as lives are forked."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "lab.stability.kills"]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, check=True, cwd=CHECKOUT, env=environment
    )
    text, is_kept = json.loads(done.stdout.splitlines()[-1])
    return text, is_kept


if __name__ == "__main__":
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as work:
        stdout = os.dup(1)
        os.dup2(2, 1)  # nerfstudio prints; the answer stands alone
        answer = json.dumps(verdict(kill_runs(KILLS, Path(work))))
        os.write(stdout, answer.encode() + b"\n")
