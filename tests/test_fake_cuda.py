"""What a GPU would see, without one: fake CUDA tensors have a device and a shape, but no values.

A tensor made on the CPU and mixed in by mistake raises FakeTensorDeviceMismatchError, as on a GPU.
Where values decide (which cells are connected, how many are placed or cloned) a
fake tensor cannot go on, and its backward pass asks for a driver: what is tested is everything up
to there. tests/test_training_on_a_gpu.py does the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.models.splatfacto import SplatfactoModelConfig
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.fx.experimental.symbolic_shapes import ShapeEnv

import desplat_ns.separation.decide as regions_of_photos
from desplat_ns.backend.gsplat_cuda import _with_unsound_behind
from desplat_ns.backend.protocol import Rendering, Splats, View
from desplat_ns.backend.ssim import _window
from desplat_ns.core.devices import state_to_device
from desplat_ns.core.effects import BackgroundGrade, Effects
from desplat_ns.core.schedule import NominalStep, RunStep
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.distractors.placement import distractor_weight
from desplat_ns.distractors.refinement import DistractorDensifier, strategy_info
from desplat_ns.distractors.sets import PARAMETER_NAMES, ViewDistractors
from desplat_ns.gaussians.activation import activate_distractors
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
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.separation.decide import Thresholds
from desplat_ns.separation.grid import _shares
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS
from desplat_ns.step import Step
from desplat_ns.training.step_guard import sum_of_squares

WIDTH, HEIGHT, N = 60, 40, 50
CONFIG = DistractorConfig(per_view=100, start="residual", static_alone=True, static_warmup=5)
WIDTHS = dict(zip(PARAMETER_NAMES, (3, 3, 4, 3, 1), strict=True))
"""Values per distractor."""
EARLY = 7
"""A step at which regions are found and filled."""
LATE = 20
"""A step at which regions are found, left out and filled."""


@pytest.fixture(autouse=True)
def fake_mode() -> Iterator[None]:
    """Every tensor is a fake one; those whose number of rows depends on values may be made."""
    with FakeTensorMode(shape_env=ShapeEnv()):
        yield
    for kept in (_window, _shares):
        kept.cache_clear()  # a fake one is of use in its own mode only


def cuda(*shape: int) -> Tensor:
    return torch.rand(*shape, device="cuda")


def the_view() -> View:
    return View(cuda(4, 4), cuda(3, 3), WIDTH, HEIGHT)


def rendering(count: int = N) -> Rendering:
    radii = torch.ones(count, dtype=torch.int32, device="cuda")
    return Rendering(cuda(HEIGHT, WIDTH, 3), cuda(HEIGHT, WIDTH, 1), None, cuda(1, count, 2), radii)


def a_layer(background: BackgroundGrade = "off") -> Distractors:
    """What looks for regions, without what asks cameras where they stand. What other photos leave
    unexplained is found by a thread, which puts it on the GPU."""
    layer = Distractors.__new__(Distractors)
    nn.Module.__init__(layer)
    layer.background, layer.is_behind_by_chance = background, background == "off"
    layer.regions = {}
    sweep: Any = SimpleNamespace(photos={}, unexplained=lambda _, device: cuda(HEIGHT, WIDTH))
    layer.sweep, layer.thresholds = sweep, Thresholds()
    layer.config, layer.views = CONFIG, [distractors_with_moments()] * 8
    return layer


def a_step(number: int) -> Step:
    at = NominalStep(number), RunStep(number)
    step = Step(*at, 0, the_view(), rendering(), rendering(9))
    step.photo, step.static_rgb = cuda(HEIGHT, WIDTH, 3), cuda(HEIGHT, WIDTH, 3)
    return step


def assert_on_cuda(*values: Any) -> None:
    for tensor in values:
        assert isinstance(tensor, Tensor) and tensor.device.type == "cuda"


@pytest.fixture
def regions_by_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which cells are connected is OpenCV's to say, on the CPU."""
    monkeypatch.setattr(regions_of_photos, "outlier_regions", lambda weak, strong: weak & strong)


@pytest.mark.usefixtures("regions_by_cell")
@pytest.mark.parametrize(("number", "masked"), [(0, False), (EARLY, True), (LATE, False)])
def test_looking_for_regions_and_what_follows_from_them_stays_on_the_gpu(number, masked):
    """Residual, expected residual, statistics, excess, detail, outlines, weights, losses."""
    layer, state = a_layer("image" if masked else "off"), {}
    mask = cuda(HEIGHT, WIDTH, 1) > 0.5 if masked else None
    for _ in range(2):
        step = a_step(number)
        step.mask, step.behind, alpha_d = mask, step.photo, cuda(HEIGHT, WIDTH, 1)
        layer.look(step, cuda(N, 1), state)
        photo, static, weight = (
            step.photo,
            step.static_rgb,
            distractor_weight(alpha_d, step.in_region),
        )
        losses = photometric_losses(photo, weight, 0.2, static, static, leak=0.03)
        losses += (distractor_opacity_loss(alpha_d, step.in_region),)
        losses += (static_transparency_loss(alpha_d, weight),)
        assert step.residual_medians is not None
        assert_on_cuda(step.residual_medians, *losses)
        state[RESIDUAL_MEDIANS] = step.residual_medians
    assert_on_cuda(step.sweep_photo)
    assert (step.regions is None) == (number < CONFIG.warmup)
    if step.regions is not None:
        assert_on_cuda(step.regions)


def distractors_with_moments() -> ViewDistractors:
    """Those of one view, with Adams that have stepped."""
    view = ViewDistractors({name: cuda(N, width) for name, width in WIDTHS.items()})
    for name, parameter in view.params.items():
        view.optimizers[name] = adam = torch.optim.Adam([parameter])
        moments = {key: torch.zeros_like(parameter) for key in ("exp_avg", "exp_avg_sq")}
        adam.state[parameter] = {"step": torch.tensor(1.0), **moments}
    return view


@pytest.mark.parametrize("start", ["residual", "everywhere"])
def test_densification_stays_on_the_gpu_until_it_counts_what_to_clone(start):
    distractors = distractors_with_moments()
    config = replace(CONFIG, start=start)
    densifier = DistractorDensifier(config, SplatfactoModelConfig(warmup_length=0), every=1)
    view, drawn = the_view(), rendering()
    means2d: Any = drawn.means2d
    means2d.absgrad = cuda(1, N, 2)
    info = strategy_info(drawn, view)
    distractors.refinement, step = LATE, NominalStep(LATE)  # not due
    for _ in range(2):
        densifier.after_step(distractors, step, info, lambda params: params["means"][:, 0])
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
    for name in PARAMETER_NAMES:
        assert_on_cuda(view.optimizers[name].state[view.params[name]]["exp_avg"])


def test_layers_and_losses_stay_on_the_gpu():
    static, distractor = rendering(), rendering(9)
    photo, background = cuda(HEIGHT, WIDTH, 3), cuda(3)
    image = over_background(static.rgb, static.alpha, background)
    outputs = static_outputs(static, image, background)
    rgb = outputs["rgb"]
    outputs |= layered_outputs(image, rgb, distractor)
    outputs |= {"empty": layered_outputs(image, rgb, None)["rgb_composite"]}
    assert_on_cuda(*outputs.values())
    alpha_d, alpha_s = outputs["alpha_distractor"], outputs["accumulation"]
    owned = distractor_weight(alpha_d)
    losses = [
        distractor_opacity_loss(alpha_d),
        distractor_opacity_loss(alpha_d, owned),
        static_transparency_loss(alpha_s),
        mean_shown_opacity(cuda(N, 1), static.visible),
        *photometric_losses(photo, owned, 0.2, outputs["rgb"]),
        (outputs["rgb_composite"] - photo).abs().mean(),
        background_opacity_loss(alpha_d, alpha_s, explained_by_background(photo, photo, 0.1)),
    ]
    assert_on_cuda(*losses)
    assert_on_cuda(sum_of_squares(losses))


@pytest.mark.parametrize("appearance", ["affine", "sh"])
def test_appearance_and_background_stay_on_the_gpu(appearance):
    effects = Effects(appearance=appearance, background="image")
    with torch.device("cuda"):
        model = ImageEffects(effects, AppearanceConfig(), BackgroundConfig(), 4, sh_degree=3)
    features = fourier_features(cuda(N, 3), AppearanceConfig().fourier_frequencies)
    assert_on_cuda(*model.parameters(), features)
    for embedding in (model.of(2), model.mean()):
        coefficients = Splats(cuda(N, 3), cuda(N, 4), cuda(N, 3), cuda(N), cuda(N, 16, 3), 2)
        colors = Splats(cuda(N, 3), cuda(N, 4), cuda(N, 3), cuda(N), cuda(N, 3))
        toned = [
            model.apply_appearance(splats, features, embedding).colors
            for splats in (coefficients, colors)
        ]
        background = model.background_of(embedding, the_view(), degree=2)
        assert_on_cuda(*toned, background)
