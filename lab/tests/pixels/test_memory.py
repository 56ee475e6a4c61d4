from __future__ import annotations

import sys
from pathlib import Path

import pytest

from lab.performance.yardstick import YARDSTICK
from lab.pixels.memory import peak_in_this_process

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="needs Linux's /proc/self/clear_refs"
)


def test_the_yardstick_holds_what_its_graph_must():
    """At least alpha, transmittance, weight, exponent, dx and dy of every listed pair, float32."""
    try:
        peak = peak_in_this_process(YARDSTICK.address, (2000, 160, 120))
    except OSError as error:
        pytest.skip(f"the system does not tell the peak: {error}")
    from desplat_ns.calibration.scenes import make_scene
    from lab.performance.pairs import count_pairs

    listed = count_pairs(make_scene(2000, 160, 120)).listed
    assert 6 * 4 * listed / 2**20 < peak < 100 * 4 * listed / 2**20


def test_not_available_is_said(monkeypatch, capsys):
    import runpy

    def no_proc(*_):
        raise OSError("no /proc")

    monkeypatch.setattr(Path, "write_text", no_proc)
    monkeypatch.setattr(sys, "argv", ["memory", "numba", "100", "32", "32"])
    monkeypatch.delitem(sys.modules, "lab.pixels.memory")
    runpy.run_module("lab.pixels.memory", run_name="__main__")
    assert capsys.readouterr().out.strip() == "n/a"
