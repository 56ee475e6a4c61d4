from __future__ import annotations

import pytest

from desplat_ns.errors import BackendUnavailableError
from lab.gpu.parts import kernels
from lab.gpu.plan import Job


def test_kernels_are_those_of_the_package_and_failures_are_tried_again(tmp_path, monkeypatch):
    """Up to where a GPU is needed."""
    asked = []

    def resolve(name: str, device: str) -> None:
        asked.append((name, device))
        raise BackendUnavailableError("Backend 'gsplat' has no nvcc.")

    monkeypatch.setattr(kernels.kernels, "try_again", lambda: asked.append("again"))
    monkeypatch.setattr(kernels, "resolve", resolve)
    with pytest.raises(BackendUnavailableError, match=r"has no nvcc\."):
        next(kernels.measure(Job("cuda", False, str(tmp_path))))
    assert asked == ["again", ("gsplat", "cuda")]


def test_the_stand_in_draws_with_numba(tmp_path):
    (figures,) = kernels.measure(Job("cpu", True, str(tmp_path)))
    assert figures["seconds"] == 0.0
