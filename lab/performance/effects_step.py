"""What each effect adds to a training step of the whole model, and what it costs when it is off.

    python -m lab.performance.effects_step            (minutes; one thread)

All models have the same static Gaussians, the scenes of `training_step`. "Built without" is a step
of `training_step`'s kind, activation, rasterization, background, loss and Adam, in which no code of
an effect is run; "off" is the model of `desplat` with everything switched off. Distractors are
those of one view before any is placed: a view in which nothing is in the way.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import torch
from desplat_ns.static_model import StaticModel

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.scenes import Scene, make_scene
from desplat_ns.calibration.timing import threads, time_in_turns
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.rendering.compositing import over_background
from desplat_ns.rendering.views import view_of
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.machine import describe_machine

SIZES = ((20_000, 480, 270), (100_000, 648, 420))

OFF = Effects(distractors=False)
CASES: dict[str, Effects | None] = {
    "built without": None,
    "off": OFF,
    "distractors, none placed": replace(OFF, distractors=True),
    "appearance camera": replace(OFF, appearance="camera"),
    "appearance affine": replace(OFF, appearance="affine"),
    "appearance sh": replace(OFF, appearance="sh"),
    "background constant": replace(OFF, background="constant"),
    "background sh": replace(OFF, background="sh"),
    "background image": replace(OFF, background="image"),
}
"""None: a step in which no code of an effect is run."""


class BareStep(ModelStep):
    """Splatfacto's losses of Splatfacto's picture, by the same backend."""

    def losses(self) -> dict[str, torch.Tensor]:
        model, view = self.model, view_of(self.camera)
        splats = activate_static(model.gauss_params, model.config.sh_degree)
        drawn = model.rasterizer(splats, view, model.render_settings(depth=False))
        background = model._get_background_color()
        rgb = over_background(drawn.rgb, drawn.alpha, background).clamp(0, 1)
        outputs = {"rgb": rgb, "accumulation": drawn.alpha, "background": background}
        return StaticModel.get_loss_dict(model, outputs, {"image": self.photo})


def step_of(case: str, scene: Scene) -> ModelStep:
    """A case's step."""
    effects = CASES[case]
    return BareStep(scene, OFF) if effects is None else ModelStep(scene, effects)


def main() -> None:
    """Print the steps' times and their ratios to the step of a model built without effects."""
    parser = argparse.ArgumentParser(prog="python -m lab.performance.effects_step")
    parser.add_argument("--rounds", type=int, default=9, help="turns of each case (%(default)s)")
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    options = parser.parse_args()
    print(describe_machine())
    with threads(1):
        for size in SIZES:
            scene = make_scene(*size)
            steps = {name: step_of(name, scene) for name in options.only}
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
