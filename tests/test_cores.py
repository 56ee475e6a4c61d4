"""How many threads torch takes beside numba's and other programs."""

import pytest
import torch

from desplat_ns.cores import leave_cores_to_others


@pytest.mark.parametrize(("asked", "left"), [(None, 2), ("4", 4)])
def test_torch_takes_half_of_its_threads_unless_the_user_says_how_many(monkeypatch, asked, left):
    before = torch.get_num_threads()
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if asked is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", asked)
    try:
        torch.set_num_threads(4)
        leave_cores_to_others.__wrapped__()
        assert torch.get_num_threads() == left
    finally:
        torch.set_num_threads(before)
