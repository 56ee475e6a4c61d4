"""Every backend in turn."""

import pytest

from tests.backend.scenes import BACKENDS, Backend, make_backend


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    return make_backend(*request.param)


@pytest.fixture
def exact_backend(backend: Backend) -> Backend:
    if backend.name == "gsplat":
        pytest.skip("gsplat cuts opaque Gaussians off at 3 sigma, by design")
    return backend
