"""What a training step costs with each appearance model, and where the time goes.

    python -m lab.performance.appearance_step            (minutes; one thread)

The scenes and the step are those of `training_step`; with appearance the Gaussians have features of
their own and are drawn in the light of an embedding.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import torch
from torch import nn
from torch.optim import Optimizer

from desplat_ns.backend.protocol import Splats
from desplat_ns.backend.ssim import ssim
from desplat_ns.calibration.scenes import SH_DEGREE, Scene, make_scene
from desplat_ns.calibration.timing import threads, time_in_turns
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.photo_tourism.appearance import fourier_features
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.image_effects import FEATURES, ImageEffects
from desplat_ns.rendering.in_view import in_view
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.machine import describe_machine
from lab.performance.steps import product_adam
from lab.performance.training_step import TrainingStep
from lab.pixels.contenders import backends

SIZES = ((20_000, 480, 270), (100_000, 648, 420))
NUM_IMAGES = 8

Appearance = Literal["off", "affine", "sh"]
CASES: dict[str, tuple[Appearance, AppearanceConfig]] = {
    "off": ("off", AppearanceConfig()),
    "affine": ("affine", AppearanceConfig()),
    "affine, bfloat16": ("affine", AppearanceConfig(mlp_dtype="bfloat16")),
    "sh": ("sh", AppearanceConfig()),
    "sh, bfloat16": ("sh", AppearanceConfig(mlp_dtype="bfloat16")),
}


def _adam(name: str, parameter: nn.Parameter) -> Optimizer:
    """As configured; for features as for all others."""
    return product_adam("means" if name == FEATURES else name, parameter)


class LitStep(TrainingStep):
    """A step of the static scene in the light of one of its images."""

    def __init__(self, scene: Scene, appearance: Appearance, config: AppearanceConfig) -> None:
        if appearance != "off":
            features = fourier_features(scene.params["means"], config.fourier_frequencies)
            scene = replace(scene, params={**scene.params, FEATURES: features})
        contender = next(c for c in backends()[0] if c.name == "numba")
        super().__init__(scene, contender, ssim, _adam)
        self.effects: ImageEffects | None = None
        if appearance != "off":
            effects = Effects(appearance=appearance)
            torch.manual_seed(0)
            self.effects = ImageEffects(effects, config, BackgroundConfig(), NUM_IMAGES, SH_DEGREE)
            self._add_optimizers(self.effects)

    def _add_optimizers(self, effects: ImageEffects) -> None:
        assert effects.appearance is not None
        nn.init.normal_(effects.appearance.head.weight, std=1e-2)  # as if trained for a while
        for name, parameters in effects.param_groups().items():
            optimizer = torch.optim.Adam(parameters, lr=0.0, fused=True)
            self.optimizers[name] = optimizer

    def _splats(self) -> Splats:
        splats = activate_static(self.params, SH_DEGREE)
        if self.effects is None:
            return splats
        lit = self.effects.appearance_in_view(splats, self.params[FEATURES], self.view)
        return lit(self.effects.of(1))


def cpu_ms(call: Callable[[], object], repeats: int = 7) -> float:
    """CPU milliseconds, the median of some calls after one that is not counted."""
    call()
    times = []
    for _ in range(repeats):
        since = time.process_time()
        call()
        times.append(1e3 * (time.process_time() - since))
    return statistics.median(times)


def parts(step: LitStep) -> dict[str, float]:
    """CPU milliseconds of what appearance adds to a step, each part by itself."""
    effects = step.effects
    assert effects is not None and effects.appearance is not None
    splats = activate_static({n: p.detach() for n, p in step.params.items()}, SH_DEGREE)
    features = step.params[FEATURES]
    embedding = effects.of(1).detach().requires_grad_()
    rows = in_view(splats, step.view).nonzero()[:, 0]
    own = (
        [features] if effects.appearance.head.out_features > 6 else [features, splats.colors[:, 0]]
    )
    leaves = [features, embedding, *effects.appearance.parameters()]

    def network(with_backward: bool) -> Callable[[], object]:
        def call() -> None:
            out = effects.appearance._predict(embedding, own, rows)  # type: ignore[union-attr]
            if with_backward:
                torch.autograd.grad(out, leaves, torch.ones_like(out))

        return call

    adams = [step.optimizers[name] for name in (FEATURES, *effects.param_groups())]
    step.whole()
    forward, both = cpu_ms(network(False)), cpu_ms(network(True))
    return {
        "rows in view": float(len(rows)),
        "which rows are in view": cpu_ms(lambda: in_view(splats, step.view)),
        "network, forward": forward,
        "network, backward": both - forward,
        "Adam of features, network, embeddings": cpu_ms(lambda: [a.step() for a in adams]),
    }


def main() -> None:
    """Print the steps' times, their ratios to the step without appearance, and their parts."""
    parser = argparse.ArgumentParser(prog="python -m lab.performance.appearance_step")
    parser.add_argument("--rounds", type=int, default=7, help="turns of each case (%(default)s)")
    rounds = parser.parse_args().rounds
    print(describe_machine())
    with threads(1):
        for size in SIZES:
            scene = make_scene(*size)
            steps = {name: LitStep(scene, *case) for name, case in CASES.items()}
            timings = time_in_turns({name: s.whole for name, s in steps.items()}, rounds)
            for name, timing in timings.items():
                ratio = timing.cpu_ms / timings["off"].cpu_ms
                least = timing.cpu_range[0] / timings["off"].cpu_range[0]
                print(
                    f"{scene.name}, {name}: {timing.cpu_ms:.0f} CPU ms ({ratio:.2f}); "
                    f"least {timing.cpu_range[0]:.0f} ({least:.2f})"
                )
                if steps[name].effects is not None:
                    for part, value in parts(steps[name]).items():
                        print(f"    {part}: {value:,.1f}")


if __name__ == "__main__":
    main()
