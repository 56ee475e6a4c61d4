"""What a GPU would see, without one: fake CUDA tensors have a device and a shape, but no values.

A tensor made on the CPU and mixed in by mistake raises FakeTensorDeviceMismatchError, as on a GPU.
Where values decide (which cells are connected, how many are placed or cloned) a
fake tensor cannot go on, and its backward pass asks for a driver: what is tested is everything up
to there. tests/test_training_on_a_gpu.py does the whole.
"""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.fx.experimental.symbolic_shapes import ShapeEnv

from desplat_ns.backend.gsplat_cuda import _with_unsound_behind
from desplat_ns.backend.protocol import Rendering, Splats, View
from desplat_ns.backend.ssim import _window
from desplat_ns.core.devices import state_to_device
from desplat_ns.core.effects import Effects
from desplat_ns.core.schedule import NominalStep
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.distractors import apply_mask
from desplat_ns.distractors.placement import distractor_weight
from desplat_ns.distractors.refinement import DistractorDensifier
from desplat_ns.distractors.sets import ViewDistractors
from desplat_ns.gaussians.activation import activate_distractors, sigmoid
from desplat_ns.layers import layered_outputs, over_background, static_outputs
from desplat_ns.losses import (
    background_opacity_loss,
    distractor_opacity_loss,
    explained_by_background,
    mean_shown_opacity,
    photometric_losses,
    static_transparency_loss,
)
from desplat_ns.photo_tourism.appearance import fourier_features
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.separation import decide
from desplat_ns.separation.decide import StaticView, Thresholds
from desplat_ns.separation.grid import _cells_of_pixels, region_pixels
from desplat_ns.separation.residuals import medians_in
from desplat_ns.separation.sweep import photo_to_sweep

WIDTH, HEIGHT, N = 60, 40, 50
WIDTHS = {"means": 3, "scales": 3, "quats": 4, "rgbs": 3, "opacities": 1}
"""Values per distractor."""
CUDA = torch.device("cuda")


@pytest.fixture(autouse=True)
def fake_mode() -> Iterator[None]:
    """Every tensor is a fake one; those whose number of rows depends on values may be made."""
    with FakeTensorMode(shape_env=ShapeEnv()):
        yield
    for kept in (_window, _cells_of_pixels):
        kept.cache_clear()  # a fake one is of use in its own mode only


def cuda(*shape: int) -> Tensor:
    return torch.rand(*shape, device="cuda")


def the_view() -> View:
    return View(cuda(4, 4), cuda(3, 3), WIDTH, HEIGHT)


def rendering(count: int = N) -> Rendering:
    radii = torch.ones(count, dtype=torch.int32, device="cuda")
    return Rendering(cuda(HEIGHT, WIDTH, 3), cuda(HEIGHT, WIDTH, 1), None, cuda(1, count, 2), radii)


def assert_on_cuda(*values: Any) -> None:
    for tensor in values:
        assert isinstance(tensor, Tensor) and tensor.device.type == "cuda"


@pytest.mark.parametrize("masked", [False, True])
def test_what_decides_whose_a_pixel_is_and_what_follows_stays_on_the_gpu(monkeypatch, masked):
    """But for which cells are connected, which is OpenCV's to say, on the CPU."""
    monkeypatch.setattr(decide, "outlier_regions", lambda *masks_and_by: masks_and_by[:2])
    photo, drawn, medians = cuda(HEIGHT, WIDTH, 3), rendering(), medians_in({}, N, CUDA)
    static = StaticView(
        drawn.rgb, drawn.alpha, None, drawn.means2d[0], drawn.visible, sigmoid(cuda(N))
    )
    counted = None
    if masked:
        photo, counted = apply_mask(photo, drawn.rgb, cuda(HEIGHT, WIDTH, 1) > 0.5)
    comparison, medians = decide.compare(photo, static, medians, counted)
    regions = decide.decide(comparison, lambda: cuda(HEIGHT, WIDTH), Thresholds())
    alpha_d, in_region = cuda(HEIGHT, WIDTH, 1), region_pixels(regions, HEIGHT, WIDTH).float()
    owned = distractor_weight(alpha_d, in_region)
    losses = photometric_losses(photo, owned, 0.2, drawn.rgb, drawn.rgb, leak=0.03)
    losses += (distractor_opacity_loss(alpha_d, in_region),)
    losses += (static_transparency_loss(alpha_d, owned),)
    assert_on_cuda(medians, regions, photo_to_sweep(photo, None), *losses)


def distractors_with_moments() -> ViewDistractors:
    """Those of one view, with an Adam that has stepped."""
    view = ViewDistractors({name: cuda(N, width) for name, width in WIDTHS.items()})
    view.optimizer = torch.optim.Adam([{"params": [each]} for each in view.params.values()])
    for parameter in view.params.values():
        moments = {key: torch.zeros_like(parameter) for key in ("exp_avg", "exp_avg_sq")}
        view.optimizer.state[parameter] = {"step": torch.tensor(1.0), **moments}
    return view


@pytest.mark.parametrize("start", ["residual", "everywhere"])
def test_densification_stays_on_the_gpu_until_it_counts_what_to_clone(start):
    distractors = distractors_with_moments()
    config = DistractorConfig(per_view=100, start=start, static_alone=True, static_warmup=5)
    densifier = DistractorDensifier(config, SplatfactoModelConfig(warmup_length=0), every=1)
    drawn = rendering()
    means2d: Any = drawn.means2d
    means2d.absgrad = cuda(1, N, 2)
    distractors.refinement, step = 20, NominalStep(20)  # not due
    for _ in range(2):
        densifier.after_step(distractors, step, drawn, lambda params: params["means"][:, 0])
    running = distractors.state
    assert_on_cuda(running["grad2d"], running["count"])
    assert (running["radii"] is None) == (start == "residual")
    if running["radii"] is not None:
        assert_on_cuda(running["radii"])
    assert_on_cuda(state_to_device(running, torch.device("cuda"))["grad2d"])


def test_exchanging_distractors_stays_on_the_gpu():
    view = distractors_with_moments()
    splats = activate_distractors(view.params)
    assert_on_cuda(*_with_unsound_behind(splats, the_view()))  # without a look at their values
    assert_on_cuda(splats.means, splats.quats, splats.scales, splats.opacities, splats.colors)
    view.state["grad2d"] = cuda(N)
    new = {name: cuda(5, width) for name, width in WIDTHS.items()}
    view.exchange(torch.arange(0, N, 2, device="cuda"), new)
    assert_on_cuda(*view.params.values(), view.state["grad2d"])
    for name in WIDTHS:
        assert_on_cuda(view.optimizers[name].state[view.params[name]]["exp_avg"])


def test_layers_and_losses_stay_on_the_gpu():
    static, distractor = rendering(), rendering(9)
    photo, background = cuda(HEIGHT, WIDTH, 3), cuda(3)
    image = over_background(static.rgb, static.alpha, background)
    outputs = static_outputs(static, image, background)
    outputs |= layered_outputs(image, outputs["rgb"], distractor)
    outputs |= {"empty": layered_outputs(image, outputs["rgb"], None)["rgb_composite"]}
    assert_on_cuda(*outputs.values())
    alpha_d, alpha_s = outputs["alpha_distractor"], outputs["accumulation"]
    explained = explained_by_background(photo, photo, 0.1)
    losses = [
        static_transparency_loss(alpha_s),
        mean_shown_opacity(cuda(N, 1), static.visible),
        background_opacity_loss(alpha_d, alpha_s, explained),
    ]
    assert_on_cuda(*losses)


@pytest.mark.parametrize("appearance", ["affine", "sh"])
def test_appearance_and_background_stay_on_the_gpu(appearance):
    effects = Effects(appearance=appearance, background="image")
    with torch.device("cuda"):
        model = ImageEffects(effects, AppearanceConfig(), 4, sh_degree=3)
    features = fourier_features(cuda(N, 3))
    assert_on_cuda(*model.parameters(), features)
    for embedding in (model.of(2), model.of(None)):
        coefficients = Splats(cuda(N, 3), cuda(N, 4), cuda(N, 3), cuda(N), cuda(N, 16, 3), 2)
        colors = Splats(cuda(N, 3), cuda(N, 4), cuda(N, 3), cuda(N), cuda(N, 3))
        toned = [
            model.apply_appearance(splats, features, embedding).colors
            for splats in (coefficients, colors)
        ]
        background = model.background_of(embedding, the_view(), degree=2)
        assert_on_cuda(*toned, background)
