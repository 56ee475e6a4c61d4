"""Poison in formulas, files and options: finite, culled, or an error that says where."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest
import torch

from lab.stability import fuzz_files, fuzz_options
from lab.stability.fuzz_files import CULLED, FAULT, FINE, REFUSED, SOURCES, Source
from lab.stability.fuzz_formulas import FORMULAS, Formula, H, W
from lab.stability.fuzz_options import Options

FORMULA_INPUTS, FILE_INPUTS, OPTION_INPUTS = 12, 25, 25
"""Draws in this suite; `lab.stability` has many more."""


@pytest.mark.parametrize("formula", FORMULAS, ids=lambda formula: formula.name)
def test_a_formula_stays_finite_on_its_domain(formula: Formula):
    rng = random.Random(formula.name)
    faults = [fault for _ in range(FORMULA_INPUTS) for fault in formula.attempt(rng)]
    assert not faults


def test_a_formula_that_is_not_finite_would_be_found():
    image = ((0.0,), (H, W, 3))
    value = Formula("1 / 0", lambda x: 1 / x, (image,))
    slope = Formula("sqrt", lambda x: x.sqrt(), (image,))
    assert value.attempt(random.Random(0)) == ["1 / 0 is not finite"]
    assert slope.attempt(random.Random(0)) == ["sqrt: the gradient of argument 0 is not finite"]


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return fuzz_files.write_healthy(tmp_path_factory.mktemp("healthy"))


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.name)
def test_a_damaged_file_is_refused_or_harmless(source: Source, healthy, tmp_path: Path):
    rng, fates = random.Random(source.name), Counter()
    for _ in range(FILE_INPUTS):
        fates[fuzz_files.fate_of(source, rng, healthy[source.name], tmp_path / "work")] += 1
    assert set(fates) <= {REFUSED, CULLED, FINE}
    assert fates[REFUSED] + fates[CULLED] > 0


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.name)
def test_the_healthy_file_is_read(source: Source, healthy, tmp_path: Path):
    untouched = Source(source.name, lambda rng, path: None, source.read)
    fate = fuzz_files.fate_of(untouched, random.Random(0), healthy[source.name], tmp_path / "work")
    assert fate == FINE


@pytest.mark.parametrize("read", [lambda path: 1 / 0, lambda path: torch.tensor([torch.nan])])
def test_a_reader_that_crashes_or_lets_nan_through_would_be_found(read, healthy, tmp_path: Path):
    bad = Source("bad", lambda rng, path: None, read)
    fate = fuzz_files.fate_of(bad, random.Random(0), healthy["checkpoint"], tmp_path / "work")
    assert fate.startswith(FAULT)


@pytest.fixture(scope="module")
def options(healthy, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Options]:
    capture, output = healthy["COLMAP, binary"], tmp_path_factory.mktemp("output")
    return {o.name: o for o in fuzz_options.all_options(capture, output)}


NAMES = (
    "the run", "distractors", "learning rates", "captures", "splits", "evaluation", "appearance",
    "background",
)  # fmt: skip


def test_every_kind_of_option_is_tried(options: dict[str, Options]):
    assert tuple(options) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_poisoned_option_is_refused_or_harmless(name: str, options: dict[str, Options]):
    rng = random.Random(name)
    fates = Counter(fuzz_options.fate_of(options[name], rng) for _ in range(OPTION_INPUTS))
    assert set(fates) <= {REFUSED, FINE}
    assert fates[REFUSED] > 0
