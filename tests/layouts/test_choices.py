"""Our dataparsers can be named, whether or not the package's entry points are known."""

from __future__ import annotations

import pytest
import tyro

from desplat_ns.data.on_the_go import OnTheGoDataParserConfig
from desplat_ns.layouts.choices import AnyDataParser
from desplat_ns.layouts.dataparser import DeSplatDataParserConfig


@pytest.mark.usefixtures("tyro_may_build")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["desplat-data", "--downscale-factor", "2"], DeSplatDataParserConfig(downscale_factor=2)),
        (["on-the-go-data", "--train-on", "clean"], OnTheGoDataParserConfig(train_on="clean")),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_each_takes_its_options(words: list[str], expected):
    assert tyro.cli(AnyDataParser, args=words) == expected
