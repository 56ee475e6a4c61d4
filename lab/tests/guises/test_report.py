from __future__ import annotations

from lab.guises.report import page

RECORD = {
    **{"passed": 3000, "failed": 1, "error": 1, "skipped": 30, "seconds": 660, "part": "all"},
    **{"Processor": "a processor", "Python": "3.12.1", "Commit": "abc", "Date": "2026-11-24"},
}


def test_a_record_is_a_row_in_the_order_of_the_guises():
    rows = page({"gpu 3.12": RECORD, "as-is 3.10": RECORD | {"Python": "3.10.1"}}).splitlines()
    lines = [row for row in rows if "a processor" in row]
    row = "| 3.12.1 | all | 3000 | 2 | 30 | 11 | a processor | abc, 2026-11-24 |"
    assert lines[1] == f"| a GPU, which the suite hides {row}"
    assert lines[0].startswith("| this machine as it is | 3.10.1 |")
