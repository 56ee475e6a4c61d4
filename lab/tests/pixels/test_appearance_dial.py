from __future__ import annotations

import torch

from desplat_ns.calibration.scenes import make_scene
from desplat_ns.photo_tourism import appearance
from lab.pixels import appearance_dial
from lab.pixels.appearance_dial import bfloat16_unavailable_reason, toning
from lab.pixels.dial_errors import errors_of

SCENE = make_scene(300, 64, 48)


def test_bfloat16_is_coarser_by_its_bits(monkeypatch):
    """Float32 rounds at 6e-8, bfloat16 at 4e-3; sums of 128 products, three layers, and gamma and
    beta are about a tenth of the colour: two orders lie between them at least."""
    truth, fine = toning(SCENE, None).drawn(), errors_of
    float32 = fine(toning(SCENE, "float32").drawn(), truth)
    assert float32.picture < 3 * 128 * 6e-8
    monkeypatch.setattr(appearance, "has_bfloat16", lambda device: True)  # torch rounds alike
    work = toning(SCENE, "bfloat16")
    bfloat16 = fine(work.drawn(), truth)
    assert 100 * float32.picture < bfloat16.picture < 3 * 4e-3


def test_all_that_is_trained_has_a_gradient():
    work = toning(SCENE, "float32")
    forward, both = work.timed()
    forward()
    both()
    assert set(work.drawn().gradients) == {
        "features",
        "embedding",
        "zeroth",
        *(name for name, _ in work.network.named_parameters()),
    }


def test_the_random_numbers_of_the_caller_are_left_alone():
    torch.manual_seed(3)
    wanted = torch.rand(2)
    torch.manual_seed(3)
    toning(SCENE, "float32")
    assert torch.equal(torch.rand(2), wanted)


def test_a_processor_without_bfloat16_is_named(monkeypatch):
    monkeypatch.setattr(appearance_dial, "has_bfloat16", lambda device: False)
    assert "instructions" in str(bfloat16_unavailable_reason())
    monkeypatch.setattr(appearance_dial, "has_bfloat16", lambda device: True)
    assert appearance_dial.bfloat16_unavailable_reason() is None
