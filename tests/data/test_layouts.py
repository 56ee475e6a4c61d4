"""`desplat-data`: the default of every method, whose choice is kept in config.yml."""

import copy
from pathlib import Path
from typing import Any

import pytest
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.scripts import train

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.layouts import DeSplatDataParserConfig, without_prompts
from desplat_ns.training.datamanager import DeSplatDataManagerConfig, training_split


def test_options_that_are_not_given_are_the_dataparsers_own(capture):
    own = DeSplatColmapDataParserConfig(data=capture())
    assert without_prompts(DeSplatDataParserConfig(data=capture())) == own
    given = DeSplatDataParserConfig(data=capture(), auto_scale_poses=False, eval_interval=5)
    config = without_prompts(given)
    assert isinstance(config, DeSplatColmapDataParserConfig)
    assert (config.auto_scale_poses, config.eval_interval) == (False, 5)


def test_once_settled_the_choice_stays(capture, capsys):
    config = DeSplatDataManagerConfig(data=capture())
    settled = config.settle_dataparser()
    assert settled == config.dataparser == DeSplatColmapDataParserConfig(data=capture())
    (capture() / "transforms.json").write_text("{}")
    assert config.settle_dataparser() is settled
    training_split(config)
    assert capsys.readouterr().out.count("has the layout of") == 1


@pytest.mark.parametrize("is_there", [False, True])
def test_a_capture_that_cannot_be_read_leaves_no_folder_behind(
    tmp_path: Path, capture, is_there: bool
):
    data = tmp_path / "data"
    if is_there:
        data = capture()
        (data / "sparse" / "0" / "points3D.txt").write_text("1 nan")
    config: Any = copy.deepcopy(all_methods["desplat"])
    config.data, config.output_dir, config.vis = data, tmp_path / "outputs", "tensorboard"
    with pytest.raises(CaptureError):
        train.main(config)
    assert not config.output_dir.exists()
