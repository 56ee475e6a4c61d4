"""This package's data parsers by name, and the one that reads a capture."""

from dataclasses import replace

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import Nerfstudio, NerfstudioDataParserConfig
from nerfstudio.data.dataparsers.phototourism_dataparser import PhototourismDataParserConfig

from desplat_ns.core.errors import ConfigError
from desplat_ns.data.colmap import with_pycolmap
from desplat_ns.data.layouts import DeSplatDataParserConfig, desplat_dataparser
from desplat_ns.data.on_the_go import on_the_go_dataparser
from desplat_ns.data.photo_tourism import photo_tourism_dataparser
from desplat_ns.data.robustnerf import robustnerf_dataparser
from desplat_ns.data.transforms_json import TransformsDataParser

OURS = {
    "desplat-data": desplat_dataparser.config,
    "robustnerf-data": robustnerf_dataparser.config,
    "photo-tourism-data": photo_tourism_dataparser.config,
    "on-the-go-data": on_the_go_dataparser.config,
}
"""Also without the package's entry points: a checkout can be used without being installed."""


def without_prompts(config: DataParserConfig) -> DataParserConfig:
    """The dataparser that reads a capture: for desplat-data the one that it recognises, for
    upstream's that ask questions ours, else the same.

    Raises:
        CaptureError: no capture is found.
        ConfigError: upstream's phototourism-data (1.1.5), one hyphen from ours: it gives no 3D
            points and splits by its own rule, so figures would be wrong without a word.
    """
    if isinstance(config, DeSplatDataParserConfig):
        return config.recognised()
    if type(config) is PhototourismDataParserConfig:
        raise ConfigError(
            "nerfstudio's dataparser phototourism-data gives no 3D points to start from and does "
            "not read NeRF-W's split. Use photo-tourism-data, with two hyphens."
        )
    if type(config) is ColmapDataParserConfig:
        return with_pycolmap(config)
    if type(config) is NerfstudioDataParserConfig and config._target is Nerfstudio:
        return replace(config, _target=TransformsDataParser)
    return config
