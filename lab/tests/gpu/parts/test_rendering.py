from __future__ import annotations

import pytest

from lab.gpu.parts import rendering
from lab.gpu.plan import Job


@pytest.mark.slow
def test_every_case_is_drawn_with_metrics_and_without(tmp_path):
    (figures,) = rendering.measure(Job("cpu", True, str(tmp_path)))
    cases = [(row["case"], row["what"]) for row in figures["rows"]]
    names = list(rendering.NAMES.values())
    assert cases == [(name, what) for name in names for what in ("drawn", "scored")]
    assert all(row["fps"]["median"] > 0 for row in figures["rows"])
    assert figures["metrics"].startswith("PSNR, SSIM")
