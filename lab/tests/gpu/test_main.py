from __future__ import annotations

import time
from pathlib import Path

import pytest
import torch

from lab.documents import RESULTS
from lab.gpu import __main__ as command
from lab.gpu.plan import Job
from lab.gpu.records import MEASURED, WAITING, Run


def test_without_a_gpu_it_says_what_to_do_and_measures_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert command.main(["--output", str(tmp_path / "out")]) == command.NO_GPU
    said = capsys.readouterr().err
    assert "sees no GPU" in said and "nvidia-smi" in said and "--device cpu --quick" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [["--device", "cpu"], ["--quick"], ["--device", "cpu", "--quick", "--output", str(RESULTS)]],
)
def test_a_rehearsal_never_writes_into_docs(arguments, capsys):
    with pytest.raises(SystemExit):
        command.main(arguments)
    assert "name a folder other than docs" in capsys.readouterr().err


def test_what_was_spent_before_counts():
    chosen = command.parse_arguments(["--seconds", "100", "--started", str(time.time() - 30)])
    assert 60 < chosen.seconds <= 70


def test_parts_that_draw_with_gsplat_bring_its_kernels():
    def names(only, device):
        return [part.name for part in command.chosen_parts(only, Job(device, False, ""))]

    assert names(["steps"], "cuda") == ["kernels", "steps"]
    assert names(["steps"], "cpu") == ["steps"] and names(["machine"], "cuda") == ["machine"]


@pytest.mark.slow
def test_a_rehearsal_writes_its_document_and_its_records_and_a_second_one_keeps_them(
    tmp_path, monkeypatch
):
    arguments = ["--device", "cpu", "--quick", "--output", str(tmp_path), "--only", "machine"]
    assert command.main(arguments) == 0
    run = Run.load(tmp_path / "gpu.json")
    assert {name: record.state for name, record in run.parts.items()} == {"machine": MEASURED}
    assert run.parts["machine"].figures["torch"].startswith(torch.__version__)
    text = Path(tmp_path / "gpu.md").read_text()
    assert "figures mean nothing" in text and WAITING in text
    assert str(tmp_path) not in text and str(Path.home()) + "/" not in text
    before = run.parts["machine"]
    monkeypatch.setattr(command, "Runner", NothingToDo)
    assert command.main(arguments) == 0
    assert Run.load(tmp_path / "gpu.json").parts == {"machine": before}
    with pytest.raises(AssertionError, match="machine"):
        command.main([*arguments, "--again"])


class NothingToDo:
    """A runner that is given no parts."""

    def __init__(self, job, seconds, written, say, parts, run) -> None:
        assert not parts, parts
        self.run, self.written = run, written

    def __call__(self) -> Run:
        self.written(self.run)
        return self.run
