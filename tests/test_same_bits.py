"""A seed fixes a training run to the last bit, whatever the number of threads."""

from __future__ import annotations

from pathlib import Path

import numba
import pytest
import torch
from nerfstudio.scripts import train

from desplat_ns.backend.numba_kernels.runtime import numba_config


def parameters_after(config, threads: int) -> dict[str, torch.Tensor]:
    """What a run on so many threads, numba's and torch's, leaves in its checkpoint."""
    before = numba.get_num_threads(), torch.get_num_threads()
    try:
        numba.set_num_threads(threads)
        torch.set_num_threads(threads)
        train.main(config)
    finally:
        numba.set_num_threads(before[0])
        torch.set_num_threads(before[1])
    (path,) = Path(config.get_checkpoint_dir()).glob("*.ckpt")
    state = torch.load(path, weights_only=True)["pipeline"]
    return {name: value for name, value in state.items() if isinstance(value, torch.Tensor)}


@pytest.mark.skipif(numba_config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")
def test_two_runs_agree_on_one_thread_and_on_two(tiny_run, tmp_path):
    one, two = (parameters_after(tiny_run(tmp_path / str(n)), threads=n) for n in (1, 2))
    assert one.keys() == two.keys()
    for name, value in one.items():
        assert torch.equal(value, two[name]), name
