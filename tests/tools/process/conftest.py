"""The generated yard and its features, made once for all tests."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.helpers.yard import Features, Yard


@pytest.fixture(autouse=True)
def one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """On one thread the same photos give the same poses."""
    monkeypatch.setattr("desplat_ns.tools.process.reconstruction.cores", lambda: 1)


@pytest.fixture(scope="session")
def yard() -> "Yard":
    """A dozen views of a scene with texture everywhere, whose cameras are known."""
    from tests.helpers.yard import make_yard

    return make_yard()


@pytest.fixture(scope="session")
def plain(yard: "Yard", tmp_path_factory: pytest.TempPathFactory) -> "Features":
    """All views in their order, with plain features; shared: take `plain.again(folder)`."""
    return yard.features(tmp_path_factory.mktemp("plain"), range(len(yard.pictures)))


@pytest.fixture(scope="session")
def marked(yard: "Yard", tmp_path_factory: pytest.TempPathFactory) -> "Features":
    """Every other view, with what stands still in the lowest quarter of each; shared as `plain`."""
    return yard.features(tmp_path_factory.mktemp("marked"), range(0, 12, 2), is_marked=True)
