"""As many steps for an embedding as there is time for."""

from __future__ import annotations

from desplat_ns.effects import Effects
from desplat_ns.studies.tradeoff.evaluation_level import STEPS, steps_in, with_embeddings
from desplat_ns.studies.tradeoff.plan import BASE, compared, grades


def test_steps_are_taken_from_the_fewest_on_while_there_is_time():
    assert steps_in(1e9, 1.0) == STEPS
    assert steps_in(168.0, 1.0) == (0, 8, 32, 128)
    assert steps_in(167.9, 1.0) == (0, 8, 32)
    assert steps_in(0.0, 1.0) == (0,)
    assert steps_in(-1.0, 1.0) == ()
    assert steps_in(10.0, 0.0) == STEPS


def test_settings_that_differ_in_their_light_are_graded():
    settings = compared(Effects(appearance="camera"))
    assert list(grades(settings)) == [BASE, "appearance-off", "appearance-affine"]
    assert with_embeddings(settings) == ["appearance-affine"]
    with_sky = compared(Effects(background="image"))
    assert set(with_embeddings(with_sky)) == set(with_sky) - {"background"}
