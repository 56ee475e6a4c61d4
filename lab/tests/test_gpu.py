"""Without a CUDA device the script runs to its end; what is measured is not measured again."""

import json
from pathlib import Path

import pytest

from lab import gpu


def fails(job: gpu.Job) -> gpu.Figures:
    raise RuntimeError("no\nmore")


@pytest.mark.slow
def test_a_rehearsal_fills_the_page_and_a_second_one_does_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    waits = gpu.PARTS["waits"]
    monkeypatch.setitem(gpu.PARTS, "waits", fails)
    assert gpu.main(["--output", str(tmp_path)]) == 1
    assert "not measured: waits, RuntimeError: no" in (tmp_path / "gpu.md").read_text()
    for name in gpu.PARTS:
        monkeypatch.setitem(gpu.PARTS, name, fails)
    monkeypatch.setitem(gpu.PARTS, "kernels", gpu.kernels)
    monkeypatch.setitem(gpu.PARTS, "waits", waits)
    assert gpu.main(["--output", str(tmp_path)]) == 0
    parts = json.loads((tmp_path / "gpu.json").read_text())["parts"]
    assert set(parts) == set(gpu.PARTS)
    (step,) = parts["steps"].values()
    assert set(step) == set(gpu.METHODS) and min(step.values()) > 0
    assert all(set(row) == set(gpu.METHODS) for row in parts["waits"].values())
    assert all(set(row) == set(gpu.METHODS) for row in parts["training"].values())
    page = (tmp_path / "gpu.md").read_text()
    assert "figures mean nothing" in page and "not measured" not in page
