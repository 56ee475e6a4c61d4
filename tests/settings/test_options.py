"""NaN and infinity are found wherever an option holds them, and are named as they are typed."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Any

import pytest
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.errors import ConfigError
from desplat_ns.settings.options import check_finite_options, check_ranges, ranged


@pytest.fixture
def config() -> Any:
    return copy.deepcopy(all_methods["desplat"])


@pytest.mark.parametrize("name", ["desplat", "desplat-paper", "desplat-phototourism", "splatfacto"])
def test_registered_methods_pass(name: str):
    check_finite_options(all_methods[name])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_an_option_of_a_dataclass_inside_is_named_as_it_is_typed(config: Any, value: float):
    config.pipeline.model.distractors.lambda_d = value
    message = rf"`--pipeline\.model\.distractors\.lambda-d` is {value}"
    with pytest.raises(ConfigError, match=message):
        check_finite_options(config)


def test_an_optimizers_rate_is_named(config: Any):
    config.optimizers["means"]["optimizer"].lr = math.nan
    with pytest.raises(ConfigError, match=r"`--optimizers\.means\.optimizer\.lr` is nan"):
        check_finite_options(config)


@dataclass
class WithSequence:
    milestones: tuple[float, ...] = (1.0, math.inf)


def test_numbers_in_a_sequence_are_looked_at():
    with pytest.raises(ConfigError, match=r"`--milestones` is inf"):
        check_finite_options(WithSequence())


def test_training_does_not_begin_with_such_an_option(config: Any, tmp_path):
    config.output_dir, config.vis = tmp_path, "tensorboard"
    config.pipeline.model.ssim_lambda = math.nan
    with pytest.raises(ConfigError, match=r"--pipeline\.model\.ssim-lambda"):
        config.setup()


@dataclass
class WithRanges:
    share: float = ranged(0.5, "(0, 1]")
    count_of_all: int = ranged(2, "[1, inf)")
    rate: float = ranged(1.0, "(0, inf)")


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({"share": 0.0}, r"`--part\.share` is 0\.0; it has to be in \(0, 1\]\."),
        ({"share": 1.1}, r"`--part\.share` is 1\.1; it has to be in \(0, 1\]\."),
        ({"count_of_all": 0}, r"`--part\.count-of-all` is 0; it has to be 1 or more\."),
        ({"rate": 0.0}, r"`--part\.rate` is 0\.0; it has to be above 0\."),
        ({"rate": math.inf}, r"`--part\.rate` is inf; it has to be a finite number\."),
    ],
)
def test_a_number_out_of_its_interval_is_named(held: dict[str, Any], message: str):
    with pytest.raises(ConfigError, match=message):
        check_ranges(WithRanges(**held), "--part")
