"""Charts: well-formed SVG, round ticks, curves inside the axes."""

import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.report.charts import HEIGHT, MOST_TICKS, WIDTH, number, powers, svg, ticks
from desplat_ns.report.history import Chart, Curve

value = st.floats(-1e9, 1e9)


@given(low=value, width=st.floats(1e-6, 1e9))
def test_ticks_are_few_inside_and_apart(low: float, width: float):
    high = low + width
    if high - low < 1e-9 * abs(low):
        return
    found = ticks(low, high)
    assert 1 <= len(found) <= MOST_TICKS + 1
    slack = 1e-6 * (high - low) + 1e-9 * max(abs(low), abs(high))
    assert all(low - slack <= tick <= high + slack for tick in found)
    assert found == sorted(set(found))


def test_ticks_are_round():
    assert ticks(0.0, 30_000.0) == [0, 10_000, 20_000, 30_000]
    assert ticks(17.2, 31.0) == pytest.approx([20, 25, 30])
    assert [10**tick for tick in powers(-1.7, 0.0)] == pytest.approx([0.02, 0.05, 0.1, 0.2, 0.5, 1])


@pytest.mark.parametrize(
    ("figure", "text"),
    [(30_000.0, "30k"), (2500.0, "2,500"), (0.05, "0.05"), (0.0, "0"), (12.5, "12.5")],
)
def test_numbers_at_ticks_are_short(figure: float, text: str):
    assert number(figure) == text


@pytest.mark.parametrize("is_logarithmic", [True, False])
@given(values=st.lists(st.floats(1e-6, 1e7), min_size=1, max_size=20))
def test_a_chart_is_well_formed_and_its_curves_are_inside(is_logarithmic, values):
    points = tuple((float(step), v) for step, v in enumerate(values))
    drawn = svg(Chart("a <b> & c", (Curve("x", points),), is_logarithmic))
    root = ElementTree.fromstring(drawn)
    path = root.find("g/path")
    assert path is not None
    places = [float(text) for text in re.findall(r"-?\d+\.\d", path.attrib["d"])]
    assert len(places) == 2 * len(values)
    assert all(0 <= x <= WIDTH for x in places[::2])
    assert all(0 <= y <= HEIGHT for y in places[1::2])
