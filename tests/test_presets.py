"""A run is as long as the photos ask for, and config.yml says how long, and how they are read."""

import yaml

from desplat_ns.data.layouts import DeSplatDataParserConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from tests.helpers.registered import registered_desplat, set_up


def test_config_yml_has_the_settled_length_and_data_parser(tiny_scene, tmp_path):
    config = registered_desplat(tiny_scene, tmp_path, max_num_iterations=0)
    config.pipeline.model.effects.auto = False
    manager = config.pipeline.datamanager
    manager.dataparser, manager.data = DeSplatDataParserConfig(), tiny_scene.folder
    config.save_config()  # as ns-train does
    trained = set_up(config).config
    saved = yaml.load((config.get_base_dir() / "config.yml").read_text(), Loader=yaml.UnsafeLoader)
    for settled in (trained, saved):
        steps = settled.max_num_iterations
        assert steps == config.max_num_iterations > 100
        assert settled.pipeline.model.schedule_scale == steps / config.nominal_num_iterations
        parser = settled.pipeline.datamanager.dataparser
        assert parser == RobustNerfDataParserConfig(data=tiny_scene.folder)
