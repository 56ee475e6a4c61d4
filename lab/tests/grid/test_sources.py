"""Every table says of which code, and of which devices, its records are."""

from __future__ import annotations

from lab.grid.records import Record
from lab.grid.runs import Run
from lab.grid.sources import Cell, Measured, sourced_table

OLD, NEW = (letter * 40 for letter in "ab")


def measured(commit: str, seed: int = 42, device: str | None = None) -> Measured:
    backend = device and {"cpu": "numba", "cuda": "gsplat"}[device]
    return Run("off", "fox", 2, 1000, seed), Record(
        {"psnr": 1.0}, commit, "desplat", device, backend
    )


def line_below(*records: Measured) -> str:
    return sourced_table(["", "psnr"], [["name", Cell("25", records)]]).splitlines()[-1]


def test_commits_are_counted_below_a_table():
    of_three = measured(OLD), measured(NEW, 43), measured(NEW, 44)
    assert line_below(*of_three) == "Records: 2 of bbbbbbb; 1 of aaaaaaa."


def test_a_record_in_two_cells_is_counted_once():
    rows = [[Cell("25", (measured(OLD),)), Cell("0.9", (measured(OLD),))]]
    assert sourced_table(["psnr", "ssim"], rows).endswith("| 25 | 0.9 |\n\nRecords: 1 of aaaaaaa.")


def test_devices_are_named_where_a_table_has_several():
    assert line_below(measured(NEW, 42, "cpu"), measured(NEW, 43)) == "Records: 2 of bbbbbbb."
    line = line_below(measured(NEW, 42, "cpu"), measured(NEW, 43, "cuda"))
    assert line == "Records: 1 of bbbbbbb, on cpu (numba); 1 of bbbbbbb, on cuda (gsplat)."
