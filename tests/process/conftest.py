"""The generated yard and its features, made once for all tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.helpers.yard import Found, Yard


@pytest.fixture(scope="session")
def yard() -> Yard:
    """A dozen views of a scene with texture everywhere, whose cameras are known."""
    from tests.helpers.yard import make_yard

    return make_yard()


@pytest.fixture(scope="session")
def found(yard: Yard, tmp_path_factory: pytest.TempPathFactory) -> Found:
    """All views in their order, with plain features; shared: take `found.again(folder)`."""
    return _found(yard, tmp_path_factory.mktemp("found"), range(len(yard.pictures)))


@pytest.fixture(scope="session")
def marked(yard: Yard, tmp_path_factory: pytest.TempPathFactory) -> Found:
    """Every other view, with what stands still in the lowest quarter of each; shared as `found`."""
    return _found(yard, tmp_path_factory.mktemp("marked"), range(0, 12, 2), is_marked=True)


def _found(yard: Yard, folder: Path, order: Sequence[int], is_marked: bool = False) -> Found:
    from tests.helpers.yard import copied, features_of

    photos = copied(yard.write(folder / "photos", order, is_marked), folder / "copies")
    return features_of(photos, folder / "copies", folder / "database.db")
