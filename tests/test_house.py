"""Imports run one way: every room imports rooms of lower floors, and no modules form a circle."""

import ast
from graphlib import TopologicalSorter

import pytest

from lab.house import (
    FLOORS,
    PACKAGE,
    PICTURE,
    direct,
    floors,
    may_import,
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


def test_the_package_imports_nothing_of_the_laboratory_or_the_tests():
    outside = {"lab", "tests", "demo", "conftest"}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            assert outside.isdisjoint(name.split(".")[0] for name in names), path


def test_no_modules_import_each_other_in_a_circle():
    """`graphlib` names one if there is any."""
    assert len(tuple(TopologicalSorter(module_imports()).static_order())) > 100


@pytest.mark.parametrize("room", sorted(r for r in floors() if (PACKAGE / r).is_dir()))
def test_every_package_says_what_it_may_import(room):
    if room == "studies":  # all of the house
        return
    named = may_import(room)
    assert room_imports()[room] <= named
    assert all(floors()[one] < floors()[room] for one in named)


def test_what_follows_from_two_arrows_is_not_drawn():
    assert set(direct({"a": {"b", "c"}, "b": {"c"}, "c": set()})) == {("a", "b"), ("b", "c")}


def test_the_picture_is_that_of_the_code():
    """Made anew by `python -m lab.house`."""
    assert PICTURE.read_text("utf8") == picture()
