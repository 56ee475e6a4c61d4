from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from desplat_ns.calibration.scenes import make_scene, tensors_of
from desplat_ns.rendering.metrics import PSNR_MAX
from lab.pixels.contenders import contender_called
from lab.pixels.dial_errors import (
    Drawing,
    Drawn,
    errors_of,
    relative_norm,
    resized,
    scaled_view,
)
from lab.pixels.dials import EXACT, SUPERSAMPLED, TODAY, Setting

SCENE = make_scene(300, 64, 48)


def test_errors_are_as_worked_out_by_hand():
    """Off by 0.1 everywhere: RMSE 0.1, 20 dB. Gradients: 1 of 10 and 3 of 4."""
    truth = Drawn(torch.zeros(2, 3, 3), {"a": torch.tensor([6.0, 8.0]), "b": torch.tensor([4.0])})
    drawn = Drawn(
        torch.full((2, 3, 3), 0.1), {"a": torch.tensor([6.0, 9.0]), "b": torch.tensor([1.0])}
    )
    errors = errors_of(drawn, truth)
    assert errors.picture == pytest.approx(0.1) and errors.psnr == pytest.approx(20)
    assert errors.gradient == pytest.approx(0.75) and errors.worst == "b"
    assert errors_of(truth, truth).picture == 0 and errors_of(truth, truth).psnr == PSNR_MAX


def test_a_relative_error_of_3_4_and_12_is_as_worked_out_by_hand():
    """|(3, 4)| = 5 is off of |(0, 12)| = 12."""
    assert relative_norm(torch.tensor([3.0, 16.0]), torch.tensor([0.0, 12.0])) == pytest.approx(
        5 / 12
    )
    assert relative_norm(torch.zeros(2), torch.zeros(2)) == 0


def test_a_smaller_view_shows_the_same_field():
    """Odd sizes are rounded: each side has a factor of its own, and centre and corner agree."""
    view = make_scene(1, 240, 135).view
    half = scaled_view(view, 0.5)
    assert (half.width, half.height) == (120, 68)
    corner = torch.tensor([0.5 * 240 / (0.9 * 240), 0.5 * 135 / (0.9 * 240), 1.0])
    assert torch.allclose(view.K @ corner, torch.tensor([240.0, 135, 1]))
    assert torch.allclose(half.K @ corner, torch.tensor([120.0, 68, 1]))
    assert scaled_view(view, 1e-3).height == 1


def test_means_of_boxes_come_of_larger_images_and_lines_between_pixels_of_smaller_ones():
    boxes = torch.arange(16.0).reshape(4, 4, 1)
    # rows 0 1 2 3 / 4 5 6 7 / ...: the first box is 0, 1, 4, 5
    assert resized(boxes, (2, 2))[..., 0].tolist() == [[2.5, 4.5], [10.5, 12.5]]
    line = torch.tensor([0.0, 4.0]).reshape(1, 2, 1)
    assert resized(line, (1, 4))[0, :, 0].tolist() == [0, 1, 3, 4]
    assert resized(boxes, (4, 4)) is boxes


@pytest.mark.parametrize("setting", [TODAY, Setting(lists="squares"), Setting(scale=0.5)])
def test_what_is_timed_runs_and_leaves_no_gradient_behind(setting):
    drawing = Drawing(contender_called("numba"), SCENE, setting, SCENE.splats)
    for call in drawing.timed():
        call()
    assert all(tensor.grad is None for tensor in tensors_of(drawing.splats))


def test_the_mean_over_samples_settles_where_a_single_sample_does_not():
    """16 samples in a pixel are nearer to 64 than one is, whichever way one is drawn."""

    def picture(setting: Setting) -> torch.Tensor:
        return Drawing(contender_called("numba"), SCENE, setting, SCENE.splats).drawn().picture

    single = Setting(cutoff=EXACT.cutoff, stop=EXACT.stop)
    finest = picture(replace(SUPERSAMPLED, scale=8.0))
    off = (picture(SUPERSAMPLED) - finest).square().mean()
    assert off < (picture(single) - finest).square().mean()
    assert off < (picture(replace(single, antialiased=True)) - finest).square().mean()
