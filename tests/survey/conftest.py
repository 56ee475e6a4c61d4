"""Tiny generated scenes, surveyed once for all tests."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

    from lab.synthetic import SceneSpec


@pytest.fixture(scope="session")
def small_spec() -> "SceneSpec":
    """Ten views of 96x72 pixels without sky, each pixel by one ray."""
    from lab.synthetic import SceneSpec

    return SceneSpec(
        num_views=10, num_extras=1, width=96, height=72, num_points=1200, seed=3, supersample=1
    )


@pytest.fixture(scope="session")
def make_capture(
    small_spec: "SceneSpec", tmp_path_factory: pytest.TempPathFactory
) -> "Callable[..., DataparserOutputs]":
    """A capture of the small scene, changed as asked for; its clean twins unless `cluttered`."""
    from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
    from lab.synthetic import write_scene

    made: dict[str, Path] = {}

    def make(cluttered: bool = False, **changes) -> "DataparserOutputs":
        spec = replace(small_spec, **changes)
        if repr(spec) not in made:
            made[repr(spec)] = tmp_path_factory.mktemp("scene")
            write_scene(spec, made[repr(spec)])
        parser = RobustNerfDataParserConfig(
            data=made[repr(spec)], train_split_clean_clutter_ratio=float(cluttered)
        )
        return parser.setup().get_dataparser_outputs("train")

    return make


@pytest.fixture(scope="session")
def still(make_capture: "Callable[..., DataparserOutputs]") -> "DataparserOutputs":
    """Nothing in the way, one light, no sky."""
    return make_capture()
