from __future__ import annotations

import subprocess
import sys
from functools import partial
from types import SimpleNamespace
from typing import Any

import jaxtyping
import pytest
import torch

from desplat_ns.backend import BACKEND_NAMES, available, registry, resolve
from desplat_ns.errors import BackendUnavailableError


def hinder(monkeypatch: pytest.MonkeyPatch, **reasons: str | None) -> None:
    """Pretend that these backends cannot (text) or can (None) run here."""
    table = {
        name: registry._Entry(e.module, e.class_name, partial(lambda n, _: reasons.get(n), name))
        for name, e in registry._BACKENDS.items()
    }
    monkeypatch.setattr(registry, "_BACKENDS", table)
    registry._fastest.cache_clear()


@pytest.fixture(autouse=True)
def _fresh_choice():
    yield
    registry._fastest.cache_clear()


def test_each_backend_is_resolved_under_its_own_name():
    for name, reason in available().items():
        assert name in BACKEND_NAMES
        if reason is None:
            assert resolve(name).name == name  # pyright: ignore[reportArgumentType]


def test_gsplat_without_cuda_says_what_to_type(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(BackendUnavailableError) as error:
        resolve("gsplat")
    assert str(error.value) == (
        "Backend 'gsplat' needs a CUDA device and torch sees none. Add "
        "`--pipeline.model.backend numba`, or install a CUDA build of torch."
    )


def test_a_backend_of_the_other_device_says_what_to_type(monkeypatch):
    with pytest.raises(BackendUnavailableError, match=r"'numba' .* on cuda.*device-type cpu"):
        resolve("numba", "cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    with pytest.raises(BackendUnavailableError, match=r"'gsplat' .* on the cpu.*device-type cuda"):
        resolve("gsplat", "cpu")


KERNELS = "desplat_ns.backend.gsplat_kernels.kernels.unavailable_reason"


def test_auto_follows_the_device(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(KERNELS, lambda: None)
    assert registry._fastest("cuda") == "gsplat"
    assert registry._fastest("cpu") == "numba"


def test_on_cuda_without_kernels_auto_draws_with_nothing_slow_but_says_what_to_do(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(KERNELS, lambda: "has no nvcc. Install it.")
    with pytest.raises(BackendUnavailableError) as error:
        resolve("auto", "cuda")
    assert str(error.value) == (
        "Backend 'gsplat' has no nvcc. Install it.\n"
        "Or put `CUDA_VISIBLE_DEVICES=` before the command: it then runs on the CPU."
    )
    assert resolve("torch", "cuda").name == "torch"  # whoever asks for it has it


@pytest.mark.parametrize(
    ("backend", "missing", "expected"),
    [
        ("auto", None, "cuda"),
        ("gsplat", None, "cuda"),
        ("auto", "has no nvcc.", "cpu"),
        ("gsplat", "has no nvcc.", "cpu"),
        ("numba", None, "cpu"),
        ("torch", "has no nvcc.", "cuda"),
    ],
)
def test_a_trained_model_is_rendered_where_something_fast_draws(
    monkeypatch, backend, missing, expected
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(KERNELS, lambda: missing)
    device, why = registry.rendering_device(backend, "cuda")
    assert device == expected and bool(why) == (device == "cpu")
    assert missing is None or device == "cuda" or missing in why
    assert registry.rendering_device(backend, "cpu") == ("cpu", "")


def test_kernels_that_are_compiled_take_seconds_that_are_told(monkeypatch):
    clock = iter([10.0, 250.0])
    monkeypatch.setattr(registry, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    hinder(monkeypatch, gsplat=None)
    assert registry.compile_kernels("gsplat", "cuda") == 240.0


def test_numbas_kernels_are_there_when_a_run_begins(monkeypatch):
    from desplat_ns.backend.numba_kernels import runtime

    compiled = []
    monkeypatch.setattr(runtime, "_is_ready", False)
    monkeypatch.setattr(runtime, "before_first_launch", [lambda: compiled.append(True)])
    assert 0 <= registry.compile_kernels("numba", "cpu") < 60
    assert compiled == [True]


def test_a_numba_that_is_missing_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "desplat_ns.backend.numba_tiles", None)
    with pytest.raises(BackendUnavailableError, match="pip install numba"):
        resolve("numba", "cpu")


def test_an_unknown_name_lists_the_known_ones():
    unknown: Any = "cuda"
    jaxtyping.config.update("jaxtyping_disable", True)  # it would reject what is no Literal
    try:
        with pytest.raises(BackendUnavailableError, match="auto, gsplat, torch, numba"):
            resolve(unknown)
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.parametrize(
    ("reasons", "chosen"),
    [
        ({"gsplat": "no", "numba": "no"}, "torch"),
        ({"gsplat": "no", "numba": None}, "numba"),
    ],
)
def test_auto_takes_the_fastest_that_can_run(monkeypatch, reasons, chosen):
    hinder(monkeypatch, **reasons)
    assert registry._fastest("cpu") == chosen


def test_auto_says_once_which_backend_it_took_and_why_not_a_faster_one(monkeypatch, capfd):
    hinder(monkeypatch, gsplat="needs CUDA.", numba="is not installed.")
    for _ in range(3):
        assert resolve("auto").name == "torch"
    said = capfd.readouterr().out
    assert said.count("Rasterizer backend: torch.") == 1
    assert said.count("Backend 'numba' is not installed.") == 1


@pytest.mark.slow
def test_backends_are_imported_only_when_asked_for():
    code = (
        "import sys, desplat_ns.backend\n"
        "print([m for m in sys.modules if m.startswith(('gsplat', 'numba', 'nerfstudio'))\n"
        " or m.startswith('desplat_ns.backend.') and m.endswith(('_tiles', '_cuda'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
