from __future__ import annotations

import pytest
import torch

from desplat_ns.backend import compile_kernels
from desplat_ns.backend.gsplat_kernels import kernels


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was compiled, on a machine with a GPU."""
    calls: list[str] = []

    def compile_numba() -> None:
        calls.append("numba")

    def unavailable_reason() -> None:
        calls.append("gsplat")

    monkeypatch.setitem(compile_kernels.COMPILERS, "numba", compile_numba)
    monkeypatch.setattr(kernels, "unavailable_reason", unavailable_reason)
    monkeypatch.setattr(kernels, "try_again", lambda: calls.append("again"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    return calls


def test_whatever_this_machine_can_use_is_compiled(compiled, capsys):
    assert compile_kernels.main([]) == 0
    assert compiled == ["numba", "again", "gsplat"]
    said = capsys.readouterr().out
    assert "numba: kernels are there (" in said and "gsplat: kernels are there (" in said


def test_one_alone_can_be_asked_for(compiled):
    assert compile_kernels.main(["numba"]) == 0
    assert compiled == ["numba"]


def test_kernels_that_fail_are_an_exit_status_and_a_reason(compiled, monkeypatch, capsys):
    monkeypatch.setattr(kernels, "unavailable_reason", lambda: "has no nvcc.")
    assert compile_kernels.main([]) == 1
    assert "gsplat: has no nvcc." in capsys.readouterr().out


def test_a_machine_without_a_gpu_lacks_nothing_unless_gsplats_are_asked_for(
    compiled, monkeypatch, capsys
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert compile_kernels.main([]) == 0
    assert compiled == ["numba"] and "torch sees none" in capsys.readouterr().out
    assert compile_kernels.main(["gsplat"]) == 1


def test_an_unknown_backend_is_refused(compiled, capsys):
    with pytest.raises(SystemExit):
        compile_kernels.main(["torch"])
    assert "invalid choice: 'torch'" in capsys.readouterr().err
