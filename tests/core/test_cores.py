"""What of the machine a run uses: torch's threads beside numba's, and memory."""

import pytest
import torch

from desplat_ns.core.cores import _limits, leave_cores_to_others


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


@pytest.mark.parametrize(
    ("line", "folder", "limit", "used", "cached"),
    [
        ("0::/job", "job", "memory.max", "memory.current", "inactive_file"),
        ("0::/job", "", "memory.max", "memory.current", "inactive_file"),  # in a container
        (
            "7:cpu,memory:/job",
            "memory/job",
            "memory.limit_in_bytes",
            "memory.usage_in_bytes",
            "total_inactive_file",
        ),
    ],
)
def test_a_container_has_less_memory_than_its_machine(tmp_path, line, folder, limit, used, cached):
    groups, root = tmp_path / "cgroup", tmp_path / "fs"
    groups.write_text(f"3:pids:/other\n{line}\n")
    assert _limits(groups, root) == []
    (root / folder).mkdir(parents=True)
    (root / folder / limit).write_text("max\n")
    (root / folder / used).write_text("500\n")
    (root / folder / "memory.stat").write_text(f"rss 3\n{cached} 200\n")
    assert _limits(groups, root) == []
    (root / folder / limit).write_text("8000\n")
    assert _limits(groups, root) == [(8000, 300)]
