"""Steps, learning rates, photo sizes and refinements of `desplat` for some captures, by number.

Any change of these numbers changes every run; they are those of commit 60f9deb.
"""

from __future__ import annotations

import copy
from types import SimpleNamespace
from typing import Any

import pytest

from desplat_ns import trainer as trainer_module
from desplat_ns.method_configs import desplat, desplat_model
from desplat_ns.settings.effects import EffectsConfig
from tests.helpers.stub_run import StubPipelineConfig, set_up
from tests.helpers.stub_run import config as config  # a fixture

GROUPS = ("means", "scales", "opacities")
"""A rate that falls and is raised, one that is raised, one that stays."""

AT = (0.0, 0.05, 0.2, 0.5, 1.0)
"""Shares of the run."""


def a_run(config: Any, monkeypatch: pytest.MonkeyPatch, photos: int, steps: int) -> dict[str, Any]:
    """What a run of `desplat` makes of a number of photos; 0 steps: as many as they ask for."""
    capture = SimpleNamespace(cameras=[None] * photos)
    monkeypatch.setattr(trainer_module, "training_split", lambda _: capture)
    model = desplat_model(EffectsConfig())
    model.backend = "torch"
    config.pipeline = StubPipelineConfig(model=model, groups=GROUPS, photos=photos)
    config.optimizers = copy.deepcopy(desplat.config.optimizers)
    for name in ("visits", "full_rate_visits", "nominal_num_iterations"):
        setattr(config, name, getattr(desplat.config, name))
    config.max_num_iterations = steps
    trainer = set_up(config)
    steps = trainer.config.max_num_iterations
    run = model.for_run(photos)
    scale = run.schedule_scale or 1.0
    sizes = [run.downscale_factor(round(step / scale)) for step in range(steps)]
    return {
        "steps": steps,
        "refine_every": run.refine_every,
        "warmup": run.distractors.static_warmup,
        "half, whole": (sizes.index(2), sizes.index(1)),
        **{name: rates_of(trainer.optimizers, name, steps) for name in GROUPS},
    }


def rates_of(optimizers: Any, group: str, steps: int) -> list[float]:
    """The learning rates of a group, at shares of the run."""
    scheduler = optimizers.schedulers.get(group)
    if scheduler is None:
        return [optimizers.optimizers[group].param_groups[0]["lr"]] * len(AT)
    (base,), (curve,) = scheduler.base_lrs, scheduler.lr_lambdas
    return [base * curve(round(share * steps)) for share in AT]


@pytest.mark.parametrize(
    ("photos", "steps", "expected"),
    [
        (
            8,
            0,
            {
                "steps": 3000,
                "refine_every": 100,
                "warmup": 1200,
                "half, whole": (60, 600),
                "means": [4e-4, 2.5418503511177035e-4, 6.369714728855948e-5, 1.6e-5, 1.6e-6],
                "scales": [0.0125, 0.01, 0.005, 0.005, 0.005],
            },
        ),
        (
            40,
            0,
            {
                "steps": 3000,
                "refine_every": 100,
                "warmup": 3200,
                "half, whole": (160, 600),
                "means": [1.6e-4, 1.2709251755588518e-4, 6.369714728855948e-5, 1.6e-5, 1.6e-6],
                "scales": [0.005] * 5,
            },
        ),
        (
            40,
            1000,
            {
                "steps": 1000,
                "refine_every": 34,
                "warmup": 6000,
                "half, whole": (100, 200),
                "means": [
                    *(4.8e-4, 3.608985811317959e-4, 1.533970424822691e-4),
                    *(2.7712812921102027e-5, 1.6e-6),
                ],
                "scales": [0.015] * 5,
            },
        ),
        (
            500,
            0,
            {
                "steps": 30000,
                "refine_every": 1000,
                "warmup": 4000,
                "half, whole": (2000, 6000),
                "means": [
                    *(2e-4, 1.571030060463529e-4, 7.614615754863499e-5),
                    *(1.7888543819998323e-5, 1.6e-6),
                ],
                "scales": [0.00625] * 5,
            },
        ),
    ],
)
def test_a_run_without_a_budget_has_these_numbers(config, monkeypatch, photos, steps, expected):
    values = a_run(config, monkeypatch, photos, steps)
    assert values.pop("opacities") == [0.05] * len(AT)
    for name in ("means", "scales"):
        assert values.pop(name) == pytest.approx(expected.pop(name), rel=1e-12), name
    assert values == expected
