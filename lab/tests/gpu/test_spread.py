from __future__ import annotations

from lab.gpu.spread import summary


def test_median_and_tenths():
    spread = summary([float(value) for value in range(11)])
    assert spread == {"median": 5.0, "low": 1.0, "high": 9.0, "count": 11}


def test_a_single_value_has_no_spread():
    assert summary([3.0]) == {"median": 3.0, "low": 3.0, "high": 3.0, "count": 1}
