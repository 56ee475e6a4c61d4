from __future__ import annotations

import re
import socket
from pathlib import Path

import pytest

from desplat_ns.studies.machine import describe_machine
from lab.documents import CHECKOUT
from lab.performance.run import main

SECTIONS = (
    "How it is measured",
    "(Pixel, Gaussian) pairs",
    "Rasterizers",
    "A whole training step",
    "The price of distractors",
    "What is serial",
    "Peak memory",
    "Error against float64",
    "Share of what the processor can do",
    "Growth",
    "Targets",
)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    main(["--quick", "--output", str(folder)])
    return folder / "performance.md"


def test_a_quick_run_writes_every_section_and_the_plot(report: Path):
    text = report.read_text()
    assert tuple(re.findall(r"^## (.*)$", text, flags=re.M)) == SECTIONS
    assert "$" not in text
    assert (report.parent / "performance.png").read_bytes().startswith(b"\x89PNG")


def test_every_table_is_whole(report: Path):
    for block in re.findall(r"(?:^\|.*\n?)+", report.read_text(), flags=re.M):
        lines = block.strip().splitlines()
        assert len(lines) >= 3
        assert len({line.count("|") for line in lines}) == 1


def test_all_cpu_backends_are_in_it(report: Path):
    for name in ("yardstick", "numba", "torch"):
        assert re.search(rf"\| {name} \| 1 \|", report.read_text())


def test_neither_a_path_nor_the_machine_is_named(report: Path):
    text = report.read_text()
    for place in (str(CHECKOUT), str(Path.home()), str(report.parent)):
        assert place == "/" or f"{place}/" not in text
    assert not re.search(r"(?<![\w.])/(?:home|root|Users|tmp|work)/\w", text)
    assert not re.search(rf"(?<![\w-]){re.escape(socket.gethostname())}(?![\w-])", text)


def test_the_machine_is_described(report: Path):
    described = describe_machine()
    assert {"Processor", "Caches", "System", "Python", "torch", "numba", "llvmlite", "Date"} <= set(
        described
    )
    assert all(described.values())


def test_a_quick_run_must_not_overwrite_the_figures(capsys):
    with pytest.raises(SystemExit):
        main(["--quick"])
    assert "--output" in capsys.readouterr().err
