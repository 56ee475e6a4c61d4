"""A run is as long as the photos ask for, and config.yml says how long that is."""

import pytest
import yaml
from nerfstudio.configs.method_configs import all_methods

from tests.helpers.registered import registered_desplat, set_up


@pytest.mark.parametrize("name", ["desplat-quick", "desplat"])
def test_a_run_is_as_long_as_the_photos_ask_for(name, tiny_scene, tmp_path):
    config = registered_desplat(tiny_scene, tmp_path, max_num_iterations=0)
    config.visits, config.pipeline.model.effects.auto = all_methods[name].visits, False
    config.save_config()  # as ns-train does
    trained = set_up(config).config
    saved = yaml.load((config.get_base_dir() / "config.yml").read_text(), Loader=yaml.UnsafeLoader)
    for settled in (trained, saved):
        steps = settled.max_num_iterations
        assert steps == config.max_num_iterations > 100
        assert settled.pipeline.model.schedule_scale == steps / config.nominal_num_iterations
