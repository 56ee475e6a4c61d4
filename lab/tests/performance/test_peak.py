from __future__ import annotations

import pytest

from lab.performance.peak import fma_rate, peak_rates


def test_a_core_does_more_than_a_gigaflop_and_less_than_any_core_there_is():
    rates = peak_rates(seconds=0.02)
    assert set(rates) == {128, 256, 512}
    # 64 float32 a cycle, 2 operations each, at 10 GHz, would be 1280
    assert min(rates.values()) > 1 and max(rates.values()) < 2000


def test_wider_vectors_are_not_slower():
    """The chains are really vectors: scalar ones would be four times slower than the narrowest."""
    scalar, narrow = fma_rate(1, 0.05), fma_rate(4, 0.05)
    assert narrow > 2 * scalar


def test_no_time_is_no_rate():
    assert fma_rate(4, seconds=0.0) == pytest.approx(0.0)
