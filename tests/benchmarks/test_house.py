"""Imports run one way: every room imports rooms of lower floors, and no modules form a circle."""

import ast
from graphlib import TopologicalSorter

import pytest

from benchmarks.house import (
    FLOORS,
    PACKAGE,
    PICTURE,
    direct,
    floors,
    module_imports,
    picture,
    room_imports,
)


def test_every_room_has_a_floor_and_every_floor_is_of_the_house():
    assert set(room_imports()) == set(floors())
    assert sum(room != "" for rooms in FLOORS for room in rooms) == len(floors())


def test_rooms_import_rooms_of_lower_floors_only():
    floor = floors()
    upwards = [
        f"{room} (floor {floor[room]}) imports {one} (floor {floor[one]})"
        for room, imported in room_imports().items()
        for one in imported
        if floor[one] >= floor[room]
    ]
    assert upwards == []


def test_no_modules_import_each_other_in_a_circle():
    """`graphlib` names one where there is any; a package's face, which hands names on, is none."""
    faces = {
        ".".join(path.parent.relative_to(PACKAGE.parent).parts)
        for path in PACKAGE.rglob("__init__.py")
    }
    modules = {m: imported - faces for m, imported in module_imports().items() if m not in faces}
    assert len(tuple(TopologicalSorter(modules).static_order())) > 100


@pytest.mark.parametrize("folder", sorted(p.parent.name for p in PACKAGE.rglob("__init__.py")))
def test_every_package_says_what_it_is_for(folder):
    path = next(p for p in PACKAGE.rglob("__init__.py") if p.parent.name == folder)
    assert ast.get_docstring(ast.parse(path.read_text("utf8")))


def test_what_follows_from_two_arrows_is_not_drawn():
    assert set(direct({"a": {"b", "c"}, "b": {"c"}, "c": set()})) == {("a", "b"), ("b", "c")}


def test_the_picture_is_that_of_the_code():
    """Made anew by `python -m benchmarks.house`."""
    assert PICTURE.read_text("utf8") == picture()
