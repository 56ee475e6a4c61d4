"""The dataparsers that can be named at the end of a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

import tyro
from nerfstudio.configs.dataparser_configs import all_dataparsers
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

from desplat_ns.data.on_the_go import on_the_go_dataparser
from desplat_ns.data.robustnerf import robustnerf_dataparser
from desplat_ns.layouts.dataparser import desplat_dataparser
from desplat_ns.photo_tourism.dataparser import photo_tourism_dataparser

OURS = {
    "desplat-data": desplat_dataparser.config,
    "robustnerf-data": robustnerf_dataparser.config,
    "photo-tourism-data": photo_tourism_dataparser.config,
    "on-the-go-data": on_the_go_dataparser.config,
}
"""Also without the package's entry points: a checkout can be used without being installed."""

if TYPE_CHECKING:
    AnyDataParser = DataParserConfig
else:
    AnyDataParser = tyro.conf.OmitSubcommandPrefixes[
        tyro.extras.subcommand_type_from_defaults({**OURS, **all_dataparsers}, prefix_names=False)
    ]
"""Union of the configurations of nerfstudio's dataparsers and ours, as tyro's subcommands."""
