"""Write docs/results/performance.md and its plot."""

from __future__ import annotations

from pathlib import Path
from string import Template

from lab.performance.peak import FLOPS_BACKWARD, FLOPS_FORWARD
from lab.performance.results import Results
from lab.performance.tables import all_tables
from lab.pixels.accuracy import FLIP, FLIP_BUDGET
from lab.pixels.growth import draw_plot

TEMPLATE = Path(__file__).with_name("performance.md.template")
REPORT, PLOT = "performance.md", "performance.png"


def write_report(results: Results, folder: Path) -> Path:
    """Fill in the template; returns where the report is."""
    folder.mkdir(parents=True, exist_ok=True)
    numbers = {
        "flip": f"{FLIP:g}",
        "flip_budget": f"{FLIP_BUDGET:g}",
        "flops_forward": str(FLOPS_FORWARD),
        "flops_backward": str(FLOPS_BACKWARD),
    }
    text = Template(TEMPLATE.read_text()).substitute(**all_tables(results), **numbers)
    path = folder / REPORT
    path.write_text(text)
    draw_plot(results.growth, folder / PLOT)
    return path
