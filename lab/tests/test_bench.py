"""The benchmark's table has every case, and errors that rounding explains."""

import pytest

from lab.bench.__main__ import STEPS, main


@pytest.mark.slow
def test_a_quick_run_has_a_row_for_each_case(capsys: pytest.CaptureFixture[str]):
    main(["--quick"])
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| 0.3k")]
    rows = {cells[2]: cells for cells in ([c.strip() for c in line.split("|")] for line in lines)}
    assert {*STEPS, "numba, cpu", "torch, cpu"} <= rows.keys()
    assert float(rows["numba, cpu"][6]) < 1e-4 and float(rows["numba, cpu"][7].split()[0]) < 0.1
