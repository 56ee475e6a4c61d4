"""A seed fixes a training run to the last bit on any number of threads, without matrix products."""

import pytest
from nerfstudio.scripts import train

from desplat_ns.backend.numba_kernels.runtime import numba_config
from desplat_ns.core.effects import EffectsConfig
from desplat_ns.distractors.config import DistractorConfig
from lab.bench.timing import threads
from lab.synthetic import SceneSpec, write_scene
from tests.helpers.registered import last_state
from tests.helpers.stub_run import assert_same

LARGE = SceneSpec(num_views=6, num_extras=1, width=241, height=161, num_points=300, supersample=1)
"""38,801 pixels: torch splits what has 32,768 elements and more, and rounds the last of an odd part
differently."""


@pytest.mark.skipif(numba_config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")
def test_two_runs_agree_on_one_thread_and_on_two(tiny_run, tmp_path):
    """40,003 Gaussians, in a few steps: parameters, moments, and what Gaussians remember."""
    write_scene(LARGE, tmp_path / "scene")
    states = []
    for number in (1, 2):
        config = tiny_run(tmp_path / str(number))
        config.pipeline.datamanager.dataparser.data = tmp_path / "scene"
        model = config.pipeline.model
        model.distractors = DistractorConfig(start="residual", static_warmup=100)
        model.effects = EffectsConfig(appearance="camera", background="constant")
        model.random_init, model.num_random, model.random_scale = True, 40_003, 8.0
        config.max_num_iterations = 10
        with threads(number):
            train.main(config)
        states.append(last_state(config))
    assert_same(*states)
