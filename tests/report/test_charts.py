"""Charts: well-formed SVG in the page's colours, curves inside the axes, plain numbers."""

import re
from xml.etree import ElementTree

import pytest

from desplat_ns.report.charts import svg
from desplat_ns.report.history import Chart, Curve


@pytest.mark.slow
@pytest.mark.parametrize("is_logarithmic", [True, False])
@pytest.mark.parametrize("values", [(1.0,), (2.0, 2.0), (1e-6, 3.0, 1e7), tuple(range(1, 41))])
def test_a_chart_is_well_formed_and_its_curves_are_inside(is_logarithmic, values):
    points = tuple((float(step), float(v)) for step, v in enumerate(values))
    drawn = svg(Chart("a <b> & c", (Curve("x", points),), is_logarithmic))
    root = ElementTree.fromstring(drawn.replace("<svg", '<svg xmlns:xlink="x"', 1))
    _, _, width, height = map(float, root.attrib["viewBox"].split())
    style = "fill: none; stroke: var(--accent)"
    (curve,) = (e for e in root.iter("path") if e.get("style", "").startswith(style))
    places = [float(text) for text in re.findall(r"-?\d+(?:\.\d+)?", curve.attrib["d"])]
    assert len(places) >= 2
    assert all(0 <= x <= width for x in places[::2])
    assert all(0 <= y <= height for y in places[1::2])
    assert not re.search("#[0-9a-f]{6};", drawn.replace("#b0b0b0", ""))  # but for the grid


def test_ticks_have_plain_numbers():
    loss = Curve("loss", ((0.0, 0.3), (30_000.0, 0.02)))
    text = re.findall(r"<text[^>]*>([^<]*)<", svg(Chart("Loss", (loss,), is_logarithmic=True)))
    assert {"0.02", "0.1", "10,000", "30,000"} <= set(text)
