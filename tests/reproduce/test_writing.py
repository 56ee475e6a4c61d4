"""The files of a table, with the paper's figures beside ours."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.reproduce.results import Results
from desplat_ns.reproduce.tables import TABLES
from desplat_ns.reproduce.writing import (
    as_json,
    comma_separated,
    html,
    latex,
    markdown,
    write_table,
)
from tests.helpers.reproduced import MadeUpExecutor, grid_of, request_of


class _Tags(HTMLParser):
    """What is open, what is loaded from elsewhere, and the cells of table rows."""

    VOID = frozenset(("meta", "br", "img", "link"))

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elsewhere: list[str] = []
        self.cells: set[tuple[int, int]] = set()
        self._row = {"td": 0, "th": 0}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elsewhere += [str(value) for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "tr":
            self._row = {"td": 0, "th": 0}
        if tag in self._row:
            self._row[tag] += 1

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "tr" and self._row["td"]:
            self.cells.add((self._row["td"], self._row["th"]))


def results(tmp_path: Path, is_smoke: bool = False) -> Results:
    methods = ("desplat-paper", "splatfacto")
    grid = grid_of(request_of("A8", tmp_path, MadeUpExecutor(), 2, is_smoke, methods))
    grid.do()
    return grid.results()


def test_the_page_has_ours_the_papers_and_the_difference(tmp_path: Path):
    table = results(tmp_path)
    cell = next(c for c in table.cells if (c.scene, c.method) == ("Statue", "splatfacto"))
    page = markdown(table)
    text = cell.metric.text(cell.mean)
    assert (
        f"| splatfacto | {text} (paper 9:32, {cell.metric.difference(cell.mean - 572)}) |" in page
    )
    assert "| WildGaussians, the paper's | - | - | - | - | - | 58:06 | 80:30 |" in page
    for condition in ("seeds: 42, 43", "steps: 30000", "commit: c0ffee", "devices: cuda", "V100"):
        assert condition in page
    assert "--downscale-factor 8" in page and "mean of scenes" in page


def test_a_smoke_table_says_so_and_has_nothing_of_the_papers(tmp_path: Path):
    table = results(tmp_path, is_smoke=True)
    for text in (markdown(table), latex(table), html(table)):
        assert "SMOKE" in text and "(paper" not in text and "9:32" not in text
    assert as_json(table)["smoke"] is True
    assert all(cell["paper"] is None for cell in as_json(table)["cells"])


def test_csv_and_json_have_every_figure(tmp_path: Path):
    table = results(tmp_path)
    lines = comma_separated(table).splitlines()
    assert len(lines) == 1 + len(table.cells) == 1 + 2 * 12
    cell, row = table.cells[0], lines[1].split(",")
    assert row[:3] == ["A8", "False", "Statue"] and float(row[6]) == cell.mean
    assert json.loads(json.dumps(as_json(table)))["cells"][0]["values"] == list(cell.values)


def test_the_html_page_is_whole_escaped_and_has_the_papers_below_ours(tmp_path: Path):
    table = results(tmp_path)
    page = html(replace(table, failed={"a <run>": "1 < 2 & 3"}))
    cell = next(c for c in table.cells if (c.scene, c.method) == ("Statue", "splatfacto"))
    text, difference = cell.metric.text(cell.mean), cell.metric.difference(cell.mean - 572)
    assert f"<td>{text}<small>paper 9:32</small><small>{difference}</small></td>" in page
    assert '<td><span class="soft">80:30</span></td>' in page, "a row of the paper alone"
    assert "a &lt;run&gt;" in page and "1 &lt; 2 &amp; 3" in page and "<run>" not in page
    tags = _Tags()
    tags.feed(page)
    assert tags.open == [] and not tags.elsewhere, "it loads nothing"
    assert tags.cells == {(len(table.columns), 1)}, "every row has every column"


def test_latex_is_escaped(tmp_path: Path):
    table = results(tmp_path)
    text = latex(table)
    assert r"\begin{tabular}{lrrrrrrrrrrrr}" in text
    assert r"SLS-mlp (+UBP), the paper's &" in text
    memory = replace(table, table=TABLES["A7"])
    assert r"10\textasciicircum{}6" in latex(memory) and "10^6" not in latex(memory)


def test_files_appear_together_or_not_at_all(tmp_path: Path):
    table = results(tmp_path / "out")
    write_table(tmp_path / "table", table)
    names = sorted(path.name for path in (tmp_path / "table").iterdir())
    assert names == ["table.csv", "table.html", "table.json", "table.md", "table.tex"]
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"):
        write_table(tmp_path / "file" / "table", table)
