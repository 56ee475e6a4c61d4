"""Raw parameters become what a rasterizer draws."""

import math

import torch

from desplat_ns.gaussians.activation import activate_distractors, activate_static


def test_values_worked_out_by_hand():
    """Of hard numbers: `tests/stability/test_stability_formulas.py`."""
    rgbs = torch.tensor([[-0.5, 0.0, 0.25], [1.0, 1.5, 0.75]])
    params = {
        "means": torch.arange(6.0).reshape(2, 3),
        "scales": torch.full((2, 3), math.log(2.0)),
        "quats": torch.tensor([[1.0, 0, 0, 0]]).repeat(2, 1),
        "features_dc": torch.full((2, 3), 0.5),
        "features_rest": torch.full((2, 15, 3), 0.25),
        "opacities": torch.zeros(2, 1),
        "rgbs": rgbs,
    }
    static, distractors = activate_static(params, sh_degree=3), activate_distractors(params)
    for splats in (static, distractors):
        assert torch.allclose(splats.scales, torch.full((2, 3), 2.0))
        assert torch.equal(splats.opacities, torch.full((2,), 0.5))
    assert static.colors.shape == (2, 16, 3)
    assert torch.equal(static.colors[:, 0], torch.full((2, 3), 0.5))
    assert torch.equal(distractors.colors, torch.tensor([[0.0, 0.0, 0.25], [1.0, 1.0, 0.75]]))
