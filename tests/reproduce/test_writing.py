"""The files of a table, with the paper's figures beside ours."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.reproduce.tables import TABLES
from desplat_ns.reproduce.writing import (
    Results,
    as_json,
    comma_separated,
    latex,
    markdown,
    write_table,
)
from tests.helpers.reproduced import MadeUpExecutor, grid_of, request_of


def results(tmp_path: Path, is_smoke: bool = False) -> Results:
    methods = ("desplat-paper", "splatfacto")
    grid = grid_of(request_of("A8", tmp_path, MadeUpExecutor(), 2, is_smoke, methods))
    grid.do()
    return grid.results()


def test_the_page_has_ours_the_papers_and_the_difference(tmp_path: Path):
    found = results(tmp_path)
    cell = next(c for c in found.cells if (c.scene, c.method) == ("Statue", "splatfacto"))
    page = markdown(found)
    text = cell.metric.text(cell.mean)
    assert (
        f"| splatfacto | {text} (paper 9:32, {cell.metric.difference(cell.mean - 572)}) |" in page
    )
    assert "| WildGaussians, the paper's | - | - | - | - | - | 58:06 | 80:30 |" in page
    for condition in ("seeds: 42, 43", "steps: 30000", "commit: c0ffee", "devices: cuda", "V100"):
        assert condition in page
    assert "--downscale-factor 8" in page and "mean of scenes" in page


def test_a_smoke_table_says_so_and_has_nothing_of_the_papers(tmp_path: Path):
    found = results(tmp_path, is_smoke=True)
    for text in (markdown(found), latex(found)):
        assert "SMOKE" in text and "(paper" not in text and "9:32" not in text
    assert as_json(found)["smoke"] is True
    assert all(cell["paper"] is None for cell in as_json(found)["cells"])


def test_csv_and_json_have_every_figure(tmp_path: Path):
    found = results(tmp_path)
    lines = comma_separated(found).splitlines()
    assert len(lines) == 1 + len(found.cells) == 1 + 2 * 12
    cell, row = found.cells[0], lines[1].split(",")
    assert row[:3] == ["A8", "False", "Statue"] and float(row[6]) == cell.mean
    assert json.loads(json.dumps(as_json(found)))["cells"][0]["values"] == list(cell.values)


def test_latex_is_escaped(tmp_path: Path):
    found = results(tmp_path)
    text = latex(found)
    assert r"\begin{tabular}{lrrrrrrrrrrrr}" in text
    assert r"SLS-mlp (+UBP), the paper's &" in text
    memory = replace(found, table=TABLES["A7"])
    assert r"10\textasciicircum{}6" in latex(memory) and "10^6" not in latex(memory)


def test_files_appear_together_or_not_at_all(tmp_path: Path):
    found = results(tmp_path / "out")
    write_table(tmp_path / "table", found)
    names = sorted(path.name for path in (tmp_path / "table").iterdir())
    assert names == ["table.csv", "table.json", "table.md", "table.tex"]
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"):
        write_table(tmp_path / "file" / "table", found)
