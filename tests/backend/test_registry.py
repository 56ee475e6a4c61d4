import pytest
import torch

from desplat_ns.backend import compile_kernels, resolve
from desplat_ns.backend.numba_kernels import runtime
from desplat_ns.core.errors import BackendUnavailableError
from desplat_ns.plugin import where_to_render

KERNELS = "desplat_ns.backend.gsplat_build.unavailable_reason"


def test_auto_follows_the_device(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(KERNELS, lambda: None)
    names = [resolve("auto", device).name for device in ("cuda", "cpu", "mps")]
    assert names == ["gsplat", "numba", "torch"]


@pytest.mark.parametrize(
    ("name", "device", "has_gpu", "said"),
    [
        ("gsplat", "cuda", False, "backend numba"),
        ("numba", "cuda", True, "device-type cpu"),
        ("gsplat", "cpu", True, "device-type cuda"),
        ("auto", "cuda", True, "CUDA_VISIBLE_DEVICES="),  # nothing slow draws unasked
    ],
)
def test_a_backend_that_cannot_draw_there_says_what_to_type(
    monkeypatch, name, device, has_gpu, said
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: has_gpu)
    monkeypatch.setattr(KERNELS, lambda: "has no nvcc. Install it.")
    with pytest.raises(BackendUnavailableError, match=said):
        resolve(name, device)
    if has_gpu:
        assert resolve("torch", "cuda").name == "torch"  # whoever asks for it has it


@pytest.mark.parametrize(
    ("backend", "missing", "expected"),
    [
        ("auto", None, "cuda"),
        ("gsplat", "has no nvcc.", "cpu"),
        ("numba", None, "cpu"),
        ("torch", "has no nvcc.", "cuda"),
    ],
)
def test_a_trained_model_is_rendered_where_something_fast_draws(
    monkeypatch, backend, missing, expected, capsys
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(KERNELS, lambda: missing)
    assert where_to_render(backend, "cuda") == expected
    said = " ".join(capsys.readouterr().out.split())
    assert bool(said) == (expected == "cpu")
    assert missing is None or expected == "cuda" or missing in said
    assert where_to_render(backend, "cpu") == "cpu"


@pytest.mark.parametrize("has_gpu", [True, False])
def test_the_command_compiles_what_the_machine_needs_and_fails_where_that_fails(
    monkeypatch, has_gpu
):
    """gsplat's kernels fail here; a machine without a GPU lacks them only where they are asked
    for."""
    compiled = []
    monkeypatch.delenv("TORCH_CUDA_ARCH_LIST", raising=False)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: has_gpu)
    monkeypatch.setattr(runtime, "prepare", lambda: compiled.append("numba"))
    monkeypatch.setattr(KERNELS, lambda: compiled.append("gsplat") or "has no nvcc.")
    assert compile_kernels.main([]) == has_gpu
    assert compiled == (["numba", "gsplat"] if has_gpu else ["numba"])
    assert compile_kernels.main(["numba"]) == 0
    assert compile_kernels.main(["gsplat"]) == 1
