"""Numbers out of their interval are found and named as typed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import reduce
from typing import Any

import pytest

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.options import check_ranges, ranged
from tests.helpers.registered import set_up


@pytest.mark.parametrize(
    ("option", "value"),
    [
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
        ("pipeline.model.distractors.strong_excess", math.nan),
        ("pipeline.model.distractors.strong_excess", -5.0),
        ("pipeline.model.distractors.lambda_d", math.nan),
        ("pipeline.model.distractors.lambda_s", -5.0),
        ("pipeline.model.distractors.static_warmup", -5),
        ("pipeline.model.distractors.static_warmup", 20_000),
        ("pipeline.datamanager.photo_memory", 0.0),
    ],
)
def test_training_does_not_begin_with_a_number_that_cannot_be(tiny_run, tmp_path, option, value):
    config = tiny_run(tmp_path)
    *parts, name = option.split(".")
    setattr(reduce(getattr, parts, config), name, value)
    with pytest.raises(ConfigError, match=re.escape(f"--{option.replace('_', '-')}")):
        set_up(config)


@dataclass
class WithRanges:
    share: float = ranged(0.5, "(0, 1]")
    count_of_all: int = ranged(2, "[1, inf)")


@pytest.mark.parametrize(
    ("held", "option"),
    [
        ({"share": 0.0}, "share"),
        ({"share": 1.1}, "share"),
        ({"count_of_all": 0}, "count-of-all"),
        ({"count_of_all": math.inf}, "count-of-all"),
    ],
)
def test_a_number_out_of_its_interval_is_named(held: dict[str, Any], option: str):
    check_ranges(WithRanges(share=1.0, count_of_all=1))
    with pytest.raises(ConfigError, match=rf"`--part\.{option}` is"):
        check_ranges(WithRanges(**held), "--part")
