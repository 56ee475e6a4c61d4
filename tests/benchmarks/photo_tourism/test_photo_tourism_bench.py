"""The study of docs/photo_tourism.md: its settings, its right halves, its tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from benchmarks.photo_tourism import study as photo_tourism
from benchmarks.photo_tourism.study import RUNS, SETTINGS, STEPS, load, report, right_half_psnr
from desplat_ns.method_configs import desplat, desplat_phototourism, desplat_phototourism_a

SPECIFICATIONS = (desplat, desplat_phototourism, desplat_phototourism_a)
METHODS = {m.config.method_name: m.config for m in SPECIFICATIONS}


def test_the_document_is_that_of_the_records(checkout: Path):
    assert (checkout / "docs" / "photo_tourism.md").read_text() == report(load())


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=list(SETTINGS))
def test_a_setting_switches_effects_of_its_method(setting):
    config: Any = METHODS[setting.method]
    names = {o.rpartition(".")[2] for o in setting.options[::2] if ".effects." in o}
    assert vars(config.pipeline.model.effects).keys() == names
    assert (config.pipeline.model.background.lambda_bg > 0) == setting.background


def test_only_the_right_half_counts(tmp_path: Path):
    photo = np.full((8, 10, 3), 100, np.uint8)
    rendering = photo.copy()
    rendering[:, 5:] = 151  # off by 0.2
    rendering[:, :5] = 255
    Image.fromarray(np.concatenate([photo, rendering], axis=1)).save(tmp_path / "a.png")
    assert right_half_psnr(tmp_path) == pytest.approx(-20 * np.log10(51 / 255))


def test_tables_hold_what_was_measured_at_todays_length():
    record = {"psnr": 12.345, "steps": STEPS["yard"], "train_seconds": 9.6, "psnr_before": 11.0}
    counts = {"num_static_gaussians": 1234, "num_distractor_gaussians": 0}
    records = {"affine-yard": record | counts, "sh-yard": record | counts | {"steps": 1}}
    text = photo_tourism.scene_table(records, "yard")
    assert "| 12.35 | 11.00 |" in text or "| 12.34 | 11.00 |" in text
    assert "1,234" in text
    assert "sh" not in text.split("\n", 2)[2].replace("desplat", "")
    assert photo_tourism.scene_table(records, "sacre") == "Not measured."


def test_every_setting_is_run_on_every_scene():
    assert len(RUNS) == len(SETTINGS) * len(STEPS) == len(set(RUNS))
