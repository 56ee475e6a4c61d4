"""The protocols are those of the supplement, Appendix B; the expected values are its text."""

from __future__ import annotations

from typing import get_args

from desplat_ns.evaluation.config import EvaluationConfig, LpipsNet
from desplat_ns.fetch.sources import SOURCES
from desplat_ns.rendering import metrics
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.protocols import (
    LPIPS_NET,
    MIPNERF360,
    ON_THE_GO,
    PHOTO_TOURISM,
    ROBUSTNERF,
    ROBUSTNERF_RATIOS,
)


def downscale(protocol) -> dict[str, int | None]:
    return {scene.name: scene.downscale for scene in protocol.scenes}


def test_robustnerf_has_five_scenes_8_times_smaller():
    names = ("Statue", "Android", "Crab (1)", "Crab (2)", "Yoda")
    assert downscale(ROBUSTNERF) == dict.fromkeys(names, 8)
    assert (ROBUSTNERF.steps, ROBUSTNERF.scoring) == (30_000, "full")


def test_the_ratios_are_varied_on_the_two_scenes_with_twins():
    assert {scene.folder for scene in ROBUSTNERF_RATIOS.scenes} == {"crab2", "yoda"}
    assert len({scene.label for scene in ROBUSTNERF_RATIOS.scenes}) == 10


def test_on_the_go_is_8_times_smaller_but_for_patio():
    names = ("Mountain", "Fountain", "Corner", "Patio", "Spot", "Patio-High")
    assert downscale(ON_THE_GO) == {**dict.fromkeys(names, 8), "Patio": 4}


def test_rooms_of_mipnerf360_are_2_times_smaller_and_outdoors_4():
    outdoor, indoor = ("bicycle", "garden", "stump"), ("room", "counter", "kitchen", "bonsai")
    assert downscale(MIPNERF360) == {**dict.fromkeys(outdoor, 4), **dict.fromkeys(indoor, 2)}
    assert MIPNERF360.parser[-2:] == ("--eval-interval", "8")


def test_photo_tourism_finds_light_on_the_left_half_in_128_steps_at_001():
    assert PHOTO_TOURISM.scoring == "half" and PHOTO_TOURISM.steps == 200_000
    assert (EvaluationConfig().steps, EvaluationConfig().learning_rate) == (128, 0.01)
    assert METHODS["desplat-phototourism-paper"].scoring(PHOTO_TOURISM) == "half"
    assert METHODS["splatfacto"].scoring(PHOTO_TOURISM) == "right", "the same pixels"
    assert METHODS["desplat-phototourism-paper"].scoring(ROBUSTNERF) == "full"


def test_protocols_name_methods_and_downloads_that_there_are():
    assert LPIPS_NET == metrics.LPIPS_NET == EvaluationConfig().lpips_net
    assert get_args(LpipsNet) == get_args(metrics.LpipsNet)
    for protocol in (ROBUSTNERF, ROBUSTNERF_RATIOS, ON_THE_GO, PHOTO_TOURISM, MIPNERF360):
        assert set(protocol.methods) <= set(METHODS)
        for scene in protocol.scenes:
            source = SOURCES[scene.fetch]
            assert f"{protocol.folder}/{scene.folder}".startswith(source.folder)
