from __future__ import annotations

import pytest

from lab.survey import unfamiliar
from lab.survey.__main__ import measure
from lab.survey.real import REAL, RealScene
from lab.survey.report import confusion_table, share_right
from lab.survey.scenes import COMBINATIONS, EVALUATION, SETTING


def test_scenes_for_thresholds_and_for_counting_have_no_seed_in_common():
    assert not {scene.seed for scene in SETTING} & {scene.seed for scene in EVALUATION}
    visible = [scene for scene in EVALUATION if scene.strengths.is_visible]
    assert len(visible) >= 40
    assert {scene.truth for scene in visible} == set(COMBINATIONS)
    strengths = {scene.strengths for scene in SETTING}
    assert not strengths & {scene.strengths for scene in EVALUATION}


def test_a_wrong_decision_lowers_the_share_and_is_in_the_table():
    truth = {"appearance": "off", "background": "off"}
    record = {
        "truth": truth,
        "decisions": {**truth, "appearance": "camera"},
        "wrong": ["appearance"],
        "figures": {"change": 0.5, "local": 0.0},
    }
    assert share_right([record]) == "1 of 2 decisions (50.0%)"
    assert "| off | 0 | 1 | 0 | 0.500 to 0.500 | 0.000 to 0.000 |" in confusion_table(
        [record], "appearance"
    )
    assert share_right([record], ("appearance",)) == "0 of 1 decisions (0.0%)"


def test_captures_of_other_kinds_are_kept_out_unless_their_names_say_so():
    assert set(unfamiliar.CHOSEN_ON) < {*unfamiliar.names()}
    assert unfamiliar.was_chosen_on("room15-clean")
    assert not unfamiliar.was_chosen_on("other15-clean")
    assert unfamiliar.right_of("other15") == {"appearance": ("off",)}


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("scene", "factor"),
    [(scene, 1) for scene in REAL]
    + [(scene, n) for scene in REAL for n in (2, 4) if scene.right["background"] != ("off",)],
    ids=lambda value: getattr(value, "name", value),
)
def test_decisions_on_real_scenes_are_right_and_where_there_is_a_sky_at_any_size(
    data_folder, scene: RealScene, factor: int
):
    survey, _ = measure(scene.open(data_folder(scene.name).parent, factor))
    for effect, decision in survey.decisions().items():
        assert decision in scene.right[effect], survey.summary()
