"""Checkpoint files survive kills, full disks and damage; a run's folder is made and taken away."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from desplat_ns.core.checkpoint import (
    checkpoint_folder,
    checkpoint_path,
    checkpoints_in,
    load_checkpoint,
    load_newest,
    remove_older,
    run_folder,
    save_atomically,
)
from desplat_ns.core.errors import CheckpointError

MODELS = Path("nerfstudio_models")


def state(step: int, size: int = 1000) -> dict[str, Any]:
    """A checkpoint whose every number tells its step."""
    return {"step": step, "pipeline": {"w": torch.full((size,), float(step))}, "optimizers": {}}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run's checkpoint folder with steps 1, 2 and 10."""
    for step in (1, 2, 10):
        save_atomically(state(step), checkpoint_path(tmp_path / MODELS, step))
    return tmp_path / MODELS


def test_of_older_ones_the_one_before_stays(folder):
    (folder / "notes.txt").write_text("mine")
    save_atomically(state(7), checkpoint_path(folder, 7))  # after 10: of another run
    remove_older(checkpoint_path(folder, 7))
    names = ["notes.txt", "step-000000002.ckpt", "step-000000007.ckpt"]
    assert sorted(p.name for p in folder.iterdir()) == names


def test_with_every_checkpoint_damaged_each_is_named_and_a_missing_one_is(folder, capsys):
    for path in checkpoints_in(folder):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])  # broken off
    with pytest.raises(CheckpointError, match="nerfstudio_models"):
        load_newest(folder)
    said = capsys.readouterr().out
    assert all(path.name in said for path in checkpoints_in(folder))
    with pytest.raises(CheckpointError, match="777"):
        load_checkpoint(checkpoint_path(folder, 777))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(where=st.integers(0, 2**30), bit=st.integers(0, 7), cut=st.booleans())
def test_damage_anywhere_is_either_harmless_or_a_checkpoint_error(folder, where, bit, cut):
    whole = (folder / "step-000000010.ckpt").read_bytes()
    at = where % len(whole)
    damaged = whole[:at] if cut else whole[:at] + bytes([whole[at] ^ 1 << bit]) + whole[at + 1 :]
    path = folder / "step-000000099.ckpt"
    path.write_bytes(damaged)
    try:
        loaded = load_checkpoint(path)
    except CheckpointError as error:
        assert "step-000000099.ckpt" in str(error)
    else:
        assert torch.equal(loaded["pipeline"]["w"], torch.full((1000,), 10.0))
    finally:
        path.unlink()


@pytest.mark.parametrize("content", [b"", b"not a checkpoint", {"weights": 0}])
def test_another_file_is_not_taken_for_a_checkpoint(tmp_path, content):
    path = tmp_path / "net.ckpt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(CheckpointError, match=r"net\.ckpt"):
        load_checkpoint(path)


def test_load_dir_is_the_checkpoints_folder_or_the_runs(tmp_path):
    folder = tmp_path / "outputs" / "scene" / "desplat" / "2026-01-01_120000" / MODELS
    path = checkpoint_path(folder, 1)
    save_atomically(state(1), path)
    assert checkpoint_folder(folder, MODELS) == checkpoint_folder(folder.parent, MODELS) == folder
    for other in (folder.parents[1], tmp_path / "nowhere", path):
        with pytest.raises(CheckpointError, match=re.escape(str(other))):
            checkpoint_folder(other, MODELS)


SAVE_UNTIL_KILLED = """
import json, os, random, signal, sys, time
from pathlib import Path
import torch
from desplat_ns.core.checkpoint import *
torch.set_num_threads(1)
base = Path(sys.argv[1])
folder = base / "nerfstudio_models"
rounds, hits, first = 0, 0, 0
random.seed(0)
while rounds < 200 and (rounds < 8 or hits < 3 or first == 0):
    child = os.fork()
    if child == 0:
        for step in range(first, 10**9):
            weights = torch.full((300_000,), float(step))
            state = {"step": step, "pipeline": {"w": weights}, "optimizers": {}}
            save_atomically(state, checkpoint_path(folder, step))
            remove_older(checkpoint_path(folder, step))
    time.sleep(random.uniform(0.02, 0.08) * (1 + rounds // 8))  # a busy machine takes longer
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    rounds += 1
    hits += (base / STAGING_FOLDER).exists()
    if not folder.exists():
        continue
    names = [p.name for p in folder.iterdir()]
    assert len(names) <= 3, names
    newest = max((int(n[n.find("-") + 1 : n.find(".")]) for n in names), default=None)  # nerfstudio
    if newest is None:
        continue
    state = load_checkpoint(checkpoint_path(folder, newest))
    assert state["step"] == newest >= first, (newest, first)
    assert torch.equal(state["pipeline"]["w"], torch.full((300_000,), float(newest)))
    first = newest
print(json.dumps({"rounds": rounds, "hits": hits, "saved": first}))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes, needs POSIX")
def test_a_kill_while_saving_leaves_the_newest_checkpoint_intact(tmp_path):
    command = [sys.executable, "-c", SAVE_UNTIL_KILLED, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["hits"] >= 3, f"no kill hit a save: {result}"
    assert result["saved"] > 0


def test_of_a_run_that_is_ended_while_it_is_set_up_no_folder_is_left(tmp_path):
    with pytest.raises(SystemExit, match="130"), run_folder(tmp_path / "outputs" / "run"):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


class _Hostile:
    def __reduce__(self) -> Any:
        return os.system, ("touch hostile",)


def test_of_a_hostile_checkpoint_nothing_is_run_and_nobody_is_told_how_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    torch.save(state(1) | {"pipeline": _Hostile()}, tmp_path / "step-000000001.ckpt")
    with pytest.raises(CheckpointError) as refused:
        load_checkpoint(tmp_path / "step-000000001.ckpt")
    assert "weights_only" not in str(refused.value)
    assert not (tmp_path / "hostile").exists()
