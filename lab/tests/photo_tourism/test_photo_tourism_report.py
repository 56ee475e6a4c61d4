"""The study of docs/results/photo_tourism.md: its settings, its right halves, its tables."""

from typing import Any

import pytest

from desplat_ns.method_configs import (
    desplat_phototourism,
    desplat_phototourism_a_paper,
    desplat_phototourism_paper,
)
from lab.grid.records import Record
from lab.grid.runs import Run
from lab.photo_tourism.report import scene_table
from lab.photo_tourism.runs import (
    EFFECTS,
    SEED,
    SETTINGS,
    STEPS,
    key_of,
)

SPECIFICATIONS = (desplat_phototourism, desplat_phototourism_paper, desplat_phototourism_a_paper)
METHODS = {m.config.method_name: m.config for m in SPECIFICATIONS}


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=list(SETTINGS))
def test_a_setting_switches_effects_of_its_method(setting):
    config: Any = METHODS[setting.method]
    options = dict(zip(setting.options[::2], setting.options[1::2], strict=True))
    names = {name.rpartition(".")[2] for name in options if ".effects." in name}
    assert vars(config.pipeline.model.effects).keys() - {"auto"} == names


def test_settings_without_appearance_are_scored_on_right_halves_too():
    for setting in SETTINGS.values():
        options = dict(zip(setting.options[::2], setting.options[1::2], strict=True))
        is_off = options[f"{EFFECTS}.appearance"] == "off"
        assert options.get("--pipeline.evaluation.protocol") == ("right" if is_off else None)


def record() -> Record:
    figures = {"psnr": 12.346, "ssim": 0.5, "psnr_before": 11.0, "num_static_gaussians": 1234}
    return Record(figures | {"train_cpu_seconds": 9.6}, "0" * 40)


def test_tables_hold_what_was_measured_at_todays_length():
    other = f"sh-yard-1-{STEPS['yard'] + 1}-{SEED}"
    records = {Run(*key_of("affine", "yard"), SEED).name: record(), other: record()}
    text = scene_table(records, "yard")
    assert "| 12.35 | 0.500 | 11.00 |" in text and "| 1,234 |" in text and "| 10 |" in text
    assert len(text.splitlines()) == len(("head", "rule", "affine", "", "Records"))
    assert scene_table(records, "sacre") == "*not measured yet*"
