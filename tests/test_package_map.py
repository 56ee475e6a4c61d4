"""Imports run one way: every part imports parts of lower layers, and no modules form a circle."""

import ast
from graphlib import TopologicalSorter

import pytest

from lab.package_map import (
    LAYERS,
    PACKAGE,
    direct,
    layers,
    may_import,
    module_imports,
    part_imports,
)


def test_every_room_has_a_floor_and_every_floor_is_of_the_house():
    assert set(part_imports()) == set(layers())
    assert sum(part != "" for parts in LAYERS for part in parts) == len(layers())


def test_rooms_import_rooms_of_lower_floors_only():
    layer = layers()
    upwards = [
        f"{part} (layer {layer[part]}) imports {other} (layer {layer[other]})"
        for part, imported in part_imports().items()
        for other in imported
        if layer[other] >= layer[part]
    ]
    assert upwards == []


def test_the_package_imports_nothing_of_the_laboratory_or_the_tests():
    outside = {"lab", "tests", "demo", "conftest"}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert outside.isdisjoint(name.split(".")[0] for name in names), path


def test_no_modules_import_each_other_in_a_circle():
    """`graphlib` names one if there is any."""
    assert len(tuple(TopologicalSorter(module_imports()).static_order())) > 100


@pytest.mark.parametrize("part", sorted(r for r in layers() if (PACKAGE / r).is_dir()))
def test_every_package_says_what_it_may_import(part):
    if part == "studies":  # all of the package
        return
    named = may_import(part)
    assert part_imports()[part] <= named
    assert all(layers()[other] < layers()[part] for other in named)


def test_what_follows_from_two_arrows_is_not_drawn():
    assert set(direct({"a": {"b", "c"}, "b": {"c"}, "c": set()})) == {("a", "b"), ("b", "c")}
