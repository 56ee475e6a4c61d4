"""Numbers out of their interval are found and named as typed."""

import math
import re
from functools import reduce

import pytest

from desplat_ns.core.errors import ConfigError
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
        ("pipeline.model.distractors.strong_excess", math.nan),
        ("pipeline.model.distractors.strong_excess", -5.0),
        ("pipeline.model.distractors.lambda_d", math.nan),
        ("pipeline.model.distractors.lambda_s", -5.0),
        ("pipeline.model.distractors.lambda_s", math.inf),
        ("pipeline.model.distractors.leak", 1.1),
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
