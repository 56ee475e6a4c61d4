"""What each effect adds to a training step of the whole model, and what it costs when it is off.

    python -m benchmarks.performance.effects_step            (minutes; one thread)

All models have the same static Gaussians, the scenes of `training_step`. "Built without" is a step
of `training_step`'s kind, activation, rasterization, background, loss and Adam, in which no code of
an effect is run; "off" is the model of `desplat` with everything switched off. Distractors are
those of one view before any is placed: a view in which nothing is in the way.
"""

from __future__ import annotations

import argparse
from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.models.splatfacto import SplatfactoModel

from desplat_ns.effects import EffectsConfig
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.gaussians.distractors import DistractorConfig
from desplat_ns.model import DeSplatModel, DeSplatModelConfig
from desplat_ns.rendering.compositing import over_background
from desplat_ns.rendering.views import view_of
from desplat_ns.studies.grid.machine import describe_machine
from desplat_ns.studies.grid.timing import threads, time_in_turns
from desplat_ns.studies.pixels.scenes import Scene, make_scene

SIZES = ((20_000, 480, 270), (100_000, 648, 420))
NUM_VIEWS = 8
LATE = 20_000
"""A step with all degrees of the harmonics, after densification."""

OFF = {"distractors": False, "appearance": "off", "background": "off"}
CASES: dict[str, dict[str, Any]] = {
    "built without": {},
    "off": OFF,
    "distractors, none placed": {**OFF, "distractors": True},
    "appearance camera": {**OFF, "appearance": "camera"},
    "appearance affine": {**OFF, "appearance": "affine"},
    "appearance sh": {**OFF, "appearance": "sh"},
    "background constant": {**OFF, "background": "constant"},
    "background sh": {**OFF, "background": "sh"},
    "background image": {**OFF, "background": "image"},
}


def cameras_of(scene: Scene) -> Cameras:
    """The scene's view, as every one of the training cameras."""
    view = scene.view
    to_world = torch.linalg.inv(view.viewmat)[:3] @ torch.diag(torch.tensor([1.0, -1, -1, 1]))
    return Cameras(
        to_world.repeat(NUM_VIEWS, 1, 1),
        float(view.K[0, 0]),
        float(view.K[1, 1]),
        float(view.K[0, 2]),
        float(view.K[1, 2]),
        view.width,
        view.height,
    )


class ModelStep:
    """A model, its optimizers, and one step of training of them all."""

    def __init__(self, scene: Scene, effects: dict[str, Any]) -> None:
        """Args:
        effects: of `EffectsConfig`; empty for a step that runs no code of an effect.
        """
        cameras = cameras_of(scene)
        config = DeSplatModelConfig(
            effects=EffectsConfig(**(effects or OFF)),
            distractors=DistractorConfig(start="residual", static_alone=True),
        )
        config.num_downscales, config.backend = 0, "numba"
        torch.manual_seed(0)
        self.bare = not effects
        self.model: DeSplatModel = config.setup(
            scene_box=SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3])),
            num_train_data=NUM_VIEWS,
            metadata={"train_cameras": cameras},
            seed_points=(
                scene.params["means"],
                torch.full(scene.params["means"].shape, 128, dtype=torch.uint8),
            ),
        )
        for name, value in scene.params.items():
            self.model.gauss_params[name].data = value.clone()
        self.model.train()
        self.model.step = LATE
        self.camera = cameras[:1]
        self.camera.metadata = {"train_idx": torch.tensor([[0]])}
        self.photo = torch.rand(scene.view.height, scene.view.width, 3)
        self.model.optimizers = {
            name: torch.optim.Adam(parameters, lr=0.0, fused=True)
            for name, parameters in self.model.get_param_groups().items()
            if parameters
        }

    def __call__(self) -> None:
        """Draw, weigh, pull back and step; nothing is densified."""
        model = self.model
        for optimizer in model.optimizers.values():
            optimizer.zero_grad()
        if self.bare:
            losses = self._bare_losses()
        else:
            losses = model.get_loss_dict(model(self.camera), {"image": self.photo})
        torch.stack(list(losses.values())).sum().backward()
        for optimizer in model.optimizers.values():
            optimizer.step()

    def _bare_losses(self) -> dict[str, torch.Tensor]:
        """Splatfacto's losses of Splatfacto's picture, by the same backend."""
        model, view = self.model, view_of(self.camera)
        splats = activate_static(model.gauss_params, model.config.sh_degree)
        drawn = model.rasterizer(splats, view, model.render_settings(depth=False))
        background = model._get_background_color()
        rgb = over_background(drawn.rgb, drawn.alpha, background).clamp(0, 1)
        outputs = {"rgb": rgb, "accumulation": drawn.alpha, "background": background}
        return SplatfactoModel.get_loss_dict(model, outputs, {"image": self.photo})


def main() -> None:
    """Print the steps' times and their ratios to the step of a model built without effects."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.performance.effects_step")
    parser.add_argument("--rounds", type=int, default=9, help="turns of each case (%(default)s)")
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    options = parser.parse_args()
    print(describe_machine())
    with threads(1):
        for size in SIZES:
            scene = make_scene(*size)
            steps = {name: ModelStep(scene, CASES[name]) for name in options.only}
            timings = time_in_turns(steps, options.rounds)
            first = timings[options.only[0]]
            for name, timing in timings.items():
                print(
                    f"{scene.name}, {name}: {timing.cpu_ms:.0f} CPU ms "
                    f"({timing.cpu_ms / first.cpu_ms:.3f}); least {timing.cpu_range[0]:.0f} "
                    f"({timing.cpu_range[0] / first.cpu_range[0]:.3f})"
                )


if __name__ == "__main__":
    main()
