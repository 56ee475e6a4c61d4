"""Numbers that cannot be are found wherever an option holds them and are named as typed."""

from __future__ import annotations

import copy
import math
import re
from dataclasses import dataclass
from functools import reduce
from typing import Any

import pytest
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.errors import ConfigError
from desplat_ns.settings.options import check_finite_options, check_ranges, ranged
from tests.helpers.registered import set_up


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("pipeline.model.ssim_lambda", math.nan),
        ("pipeline.model.schedule_scale", 0.0),
        ("pipeline.model.schedule_scale", -math.inf),
        ("pipeline.model.refine_every", -1),
        ("pipeline.model.refinements", 0),
        ("pipeline.model.gaussians_per_pixel", -0.1),
        ("pipeline.model.train_downscale", 0),
        ("pipeline.model.sh_degree", 5),
        ("pipeline.model.sh_degree_interval", 0),
        ("pipeline.model.distractors.per_view", -1),
        ("pipeline.model.distractors.weak_excess", math.nan),
        ("pipeline.model.distractors.strong_excess", 1e-3),  # below the weak one
        ("pipeline.datamanager.photo_memory", 0.0),
    ],
)
def test_training_does_not_begin_with_a_number_that_cannot_be(tiny_run, tmp_path, option, value):
    config = tiny_run(tmp_path)
    *parts, name = option.split(".")
    setattr(reduce(getattr, parts, config), name, value)
    with pytest.raises(ConfigError, match=re.escape(f"--{option.replace('_', '-')}")):
        set_up(config)


def test_an_optimizers_rate_is_named():
    config: Any = copy.deepcopy(all_methods["desplat"])
    config.optimizers["means"]["optimizer"].lr = math.nan
    with pytest.raises(ConfigError, match=r"`--optimizers\.means\.optimizer\.lr` is nan"):
        check_finite_options(config)


@dataclass
class WithRanges:
    share: float = ranged(0.5, "(0, 1]")
    count_of_all: int = ranged(2, "[1, inf)")
    milestones: tuple[float, ...] = (1.0,)


@pytest.mark.parametrize(
    ("held", "option"),
    [
        ({"share": 0.0}, "share"),
        ({"share": 1.1}, "share"),
        ({"count_of_all": 0}, "count-of-all"),
        ({"milestones": (1.0, math.inf)}, "milestones"),
    ],
)
def test_a_number_out_of_its_interval_is_named(held: dict[str, Any], option: str):
    check_ranges(WithRanges(share=1.0, count_of_all=1))
    with pytest.raises(ConfigError, match=rf"`--part\.{option}` is"):
        check_ranges(WithRanges(**held), "--part")
