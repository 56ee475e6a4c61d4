"""A study's folder: read again as it was written, and nothing else is taken for one."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.studies.plan import BASE, TrainingPlan
from desplat_ns.studies.results import FILE, Results
from desplat_ns.studies.runs import Record
from tests.helpers.tradeoff import CAPTURE

CURVE = ({"step": 100, "psnr": 18.5},)
TRAINING = {"desplat-250-42": Record({"psnr": 20.5}, "c0ffee", "cpu", "numba", CURVE)}


def test_what_is_saved_comes_back(tmp_path):
    plan = TrainingPlan(250, (BASE, "fewer"), 30_000)
    results = Results(CAPTURE, 12.5, 2, plan, TRAINING, failed={"x": "no memory"}, left_out=["a"])
    results.save(tmp_path / "new")
    loaded = Results.load(tmp_path / "new")
    assert loaded is not None and asdict(loaded) == asdict(results)


def test_a_study_by_other_code_is_not_gone_on_with(tmp_path):
    results = Results(CAPTURE, code="desplat-ns 0.0.1")
    results.save(tmp_path)
    with pytest.raises(ConfigError, match=r"holds a study by desplat-ns 0\.0\.1"):
        Results.load(tmp_path)


def test_a_new_or_empty_folder_is_free(tmp_path):
    assert Results.load(tmp_path) is None
    assert Results.load(tmp_path / "absent") is None


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(ConfigError, match="no study of this kind"):
        Results.load(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 99}', '{"format": 3}'])
def test_a_file_that_is_no_studys_is_refused(tmp_path, text):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ConfigError, match="Name another --output"):
        Results.load(tmp_path)


def test_a_disk_that_is_full_is_said_and_the_earlier_file_stays(tmp_path, monkeypatch):
    results = Results(CAPTURE)
    results.save(tmp_path)
    before = (tmp_path / FILE).read_text()

    def full(self, *args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    results.spent = 99.0
    with pytest.raises(ConfigError, match="Make room or name another --output"):
        results.save(tmp_path)
    assert (tmp_path / FILE).read_text() == before
    assert json.loads(before)["spent"] == 0.0
