"""Records come back as they were written, one line each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.studies.records import Record, load, markdown_table, save

SCORES = {"psnr": 25.5, "backend": "numba"}
OURS = Record("c0ffee", "2026-11-27", "desplat", "--steps 9", "fox", 42, SCORES, 12.5, "a CPU")


def test_records_come_back_as_they_were_written(tmp_path: Path):
    file, other = tmp_path / "records.jsonl", replace(OURS, seed=43)
    assert load(file) == {}
    save(file, [OURS, other])
    assert len(file.read_text().splitlines()) == 2
    assert load(file) == {OURS.key: OURS, other.key: other}


def test_the_later_record_of_a_run_counts(tmp_path: Path):
    again = replace(OURS, commit="beef", scores={"psnr": 26.0})
    save(tmp_path / "records.jsonl", [OURS, again])
    assert load(tmp_path / "records.jsonl") == {OURS.key: again}


@pytest.mark.parametrize("text", ["{", "[]\n", '{"seed": 1}\n', "\xff"])
def test_a_damaged_file_is_an_error(tmp_path: Path, text: str):
    (tmp_path / "records.jsonl").write_text(text, "latin1")
    with pytest.raises(ConfigError, match="damaged"):
        load(tmp_path / "records.jsonl")


def test_a_table_aligns_its_columns_and_escapes_bars():
    lines = ["| name | dB |", "| --- | ---: |", "| a\\|b | 25 |"]
    assert markdown_table(["name", "dB"], [["a|b", "25"]]).splitlines() == lines
