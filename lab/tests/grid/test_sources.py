"""No table mixes what is of different settings without saying so."""

from __future__ import annotations

from dataclasses import replace

from lab.grid.records import Record
from lab.grid.runs import Run
from lab.grid.settings import Settings
from lab.grid.sources import MARKS, Cell, Measured, sourced_table

OLD, NEW = (letter * 40 for letter in "ab")
TODAY: Settings = {"pipeline.model.refinements": 15}
BEFORE: Settings = {"pipeline.model.refinements": 12}
LATER: Settings = TODAY | {"pipeline.model.clearance": 0.5}


def measured(commit: str | None, settings: Settings | None, seed: int = 42) -> Measured:
    return Run("off", "fox", 2, 1000, seed), Record({"psnr": 1.0}, commit, settings)


def lines_of(*cells: list[Measured], older: bool = False) -> tuple[list[str], str]:
    """The texts of a table with one row for each cell, and the line below it."""
    rows = [["name", Cell("25", tuple(records))] for records in cells]
    text = sourced_table(["", "psnr"], rows, None if older else lambda run: TODAY)
    *table, _, line = text.splitlines()
    return [row.split("|")[2].strip() for row in table[2:]], line


def test_records_of_todays_settings_bear_no_mark_whatever_their_commit():
    texts, line = lines_of([measured(OLD, TODAY)], [measured(NEW, TODAY)], [measured(NEW, TODAY)])
    assert texts == ["25", "25", "25"]
    assert line == "Records: 2 of bbbbbbb; 1 of aaaaaaa."


def test_a_stale_record_is_marked_and_what_changed_is_named():
    texts, line = lines_of([measured(OLD, BEFORE)], [measured(NEW, TODAY)], [measured(OLD, BEFORE)])
    assert texts == [f"25{MARKS[0]}", "25", f"25{MARKS[0]}"]
    assert line == (
        f"Records: 1 of bbbbbbb; {MARKS[0]} 2 of aaaaaaa, with model.refinements 12 (today 15)."
    )


def test_a_table_all_of_whose_records_are_stale_says_so_without_marks():
    texts, line = lines_of([measured(OLD, BEFORE)], [measured(OLD, BEFORE)])
    assert texts == ["25", "25"]
    assert line == "Records: 2 of aaaaaaa, with model.refinements 12 (today 15)."


def test_a_setting_that_is_new_since_then_is_called_absent():
    rows = [["", Cell("25", (measured(OLD, TODAY),))]]
    text = sourced_table(["", "psnr"], rows, lambda run: LATER)
    assert text.endswith("of aaaaaaa, with model.clearance absent (today 0.5).")


def test_unknown_settings_are_no_settings_of_today():
    texts, line = lines_of([measured(None, None)], [measured(NEW, TODAY)], [measured(OLD, None)])
    assert texts == [f"25{MARKS[0]}", "25", f"25{MARKS[1]}"]
    assert line == (
        f"Records: 1 of bbbbbbb; {MARKS[0]} 1 whose commit and settings were not recorded; "
        f"{MARKS[1]} 1 of aaaaaaa, settings not recorded."
    )


def test_a_median_over_seeds_of_different_settings_is_marked():
    texts, _ = lines_of([measured(NEW, TODAY), measured(OLD, BEFORE, seed=43)])
    assert texts == [f"25{MARKS[0]}"]


def test_older_figures_are_compared_with_each_other():
    texts, line = lines_of([measured(OLD, BEFORE)], [measured(OLD, BEFORE)], older=True)
    assert texts == ["25", "25"] and line == "Records: 2 of aaaaaaa."
    texts, line = lines_of(
        [measured(OLD, BEFORE), measured(OLD, BEFORE, seed=43)],
        [measured(NEW, BEFORE)],
        [measured(None, None)],
        older=True,
    )
    assert texts == ["25", f"25{MARKS[0]}", f"25{MARKS[1]}"]


def test_older_seeds_of_one_cell_with_different_settings_are_marked():
    cell = [measured(OLD, BEFORE), measured(OLD, BEFORE, 43), measured(OLD, TODAY, 44)]
    texts, line = lines_of(cell, older=True)
    assert texts == [f"25{MARKS[0]}"]
    assert line.endswith("1 of aaaaaaa, with model.refinements 15 (others 12).")


def test_devices_are_named_and_marked_where_a_table_has_several():
    cpu, gpu = (
        [(run, replace(record, device=device, backend=backend))]
        for (run, record), device, backend in (
            (measured(NEW, TODAY), "cpu", "numba"),
            (measured(NEW, TODAY), "cuda", "gsplat"),
        )
    )
    texts, line = lines_of(cpu, cpu)
    assert line == "Records: 1 of bbbbbbb."
    texts, line = lines_of(cpu, gpu, [measured(OLD, BEFORE)])
    assert texts == ["25", f"25{MARKS[0]}", f"25{MARKS[1]}"]
    assert line.startswith(
        "Records: 1 of bbbbbbb, on cpu (numba); † 1 of bbbbbbb, on cuda (gsplat);"
    )
    assert line.endswith("(today 15), on an unknown device.")


def test_an_empty_cell_stays_empty():
    rows = [["", Cell("", (measured(None, None),)), Cell("25", (measured(NEW, TODAY),))]]
    text = sourced_table(["", "iou", "psnr"], rows, lambda run: TODAY)
    assert text.splitlines()[2] == "|  |  | 25 |"
