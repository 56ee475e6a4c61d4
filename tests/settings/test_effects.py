from __future__ import annotations

from desplat_ns.settings.effects import Effects


def test_what_is_on_is_said_in_the_words_of_the_options():
    assert Effects(appearance="camera").words == "distractors, appearance camera"
    assert Effects(distractors=False).words == ""
