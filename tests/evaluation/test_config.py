"""Which protocol holds, and which options it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.evaluation.config import EvaluationConfig, chosen_protocol


@pytest.mark.parametrize(
    ("asked", "image_light", "holds"),
    [
        ("auto", True, "half"),
        ("auto", False, "full"),
        ("full", True, "full"),
        ("half", True, "half"),
        ("right", False, "right"),
        ("right", True, "right"),
    ],
)
def test_which_protocol_holds(asked, image_light, holds):
    assert chosen_protocol(EvaluationConfig(protocol=asked), image_light) == holds


def test_halves_without_image_light_are_refused():
    with pytest.raises(ConfigError, match="appearance is off"):
        chosen_protocol(EvaluationConfig(protocol="half"), False)


@pytest.mark.parametrize("values", [{"steps": -1}, {"learning_rate": 0.0}])
def test_steps_and_rate_have_a_range(values: dict[str, Any]):
    option = "--" + next(iter(values)).replace("_", "-")
    with pytest.raises(ConfigError, match=f"`{option}` is"):
        chosen_protocol(EvaluationConfig(**values), True)
