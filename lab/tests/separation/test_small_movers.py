from __future__ import annotations

from lab.separation.small_movers import report


def test_the_table_counts_photos_by_kind_size_and_number_of_photos():
    seen = {"kind": "cut", "size": 0.01, "photos": 2, "iou": 0.8, "ghost": 0.1}
    lost = {**seen, "iou": 0.1, "ghost": 0.9}
    run = {"capture": "a", "seed": 42, "steps": 9, "false": 0.01, "false_away": 0.005}
    lines = report([{**run, "psnr": 20.0, "psnr_worst": 18.0, "sights": [seen, lost]}]).split("\n")
    assert lines[2] == "| a, 42, 9 steps | 1 of 2 | 1.00% | 0.50% | 20.00 | 18.00 |"
    assert lines[6] == "| cut | 1% | 2 | 1 of 2 | 0.45 | 0.50 |"
