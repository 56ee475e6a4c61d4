"""Mutations are of today's code, who notices one is found, and a quick run fills the page."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from lab.documents import CHECKOUT
from lab.stability.mutations import (
    MUTATIONS,
    Mutation,
    copy_of_the_checkout,
    mutated,
)
from lab.stability.mutations import noticed_by as first_that_fails
from lab.stability.report import main


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_a_mutation_changes_one_line_of_today_and_leaves_a_program(mutation: Mutation):
    source = (CHECKOUT / "desplat_ns" / mutation.file).read_text()
    changed = mutated(mutation, source)
    pairs = zip(source.splitlines(), changed.splitlines(), strict=True)
    assert sum(before != after for before, after in pairs) == 1
    ast.parse(changed)


def test_what_fails_is_named_and_what_passes_is_not(tmp_path: Path):
    (tmp_path / "test_one.py").write_text("def test_sum():\n    assert 1 + 1 == 3\n")
    (tmp_path / "test_two.py").write_text("def test_sum():\n    assert 1 + 1 == 2\n")
    assert first_that_fails("test_one.py", tmp_path) == "test_one.py::test_sum"
    assert first_that_fails("test_two.py", tmp_path) is None
    with pytest.raises(RuntimeError, match="pytest ended with"):
        first_that_fails("nowhere.py", tmp_path)


def test_the_copy_holds_what_the_tests_of_a_mutation_need(tmp_path: Path):
    folder = copy_of_the_checkout(tmp_path)
    for mutation in MUTATIONS:
        assert (folder / "desplat_ns" / mutation.file).is_file()
        paths = [word for word in mutation.tests.split() if word.endswith(".py")]
        assert paths and all((folder / path).is_file() for path in paths)


def test_a_quick_run_fills_every_table(tmp_path: Path, capsys):
    main(["--quick", "--output", str(tmp_path)])
    text = (tmp_path / "stability.md").read_text()
    assert "$" not in text
    for block in re.findall(r"(?:^\|.*\n?)+", text, flags=re.M):
        lines = [line.replace("\\|", "") for line in block.strip().splitlines()]
        assert len(lines) >= 3
        assert len({line.count("|") for line in lines}) == 1
    with pytest.raises(SystemExit):
        main(["--quick"])
    assert "--output" in capsys.readouterr().err
