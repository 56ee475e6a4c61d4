"""The registered methods. Those that end in `-paper` have the numbers of App. B.3 and Splatfacto's
and nothing else; `desplat` changes what `desplat_model` lists, refines seldom and has the effects
that a survey of the capture asks for; `desplat-phototourism` has those of tourists' photos.
"""

import torch
from nerfstudio.configs.base_config import LocalWriterConfig, LoggingConfig, MachineConfig
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from nerfstudio.plugins.types import MethodSpecification

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.optimizers import FusedAdamConfig
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.training.datamanager import DeSplatDataManagerConfig
from desplat_ns.training.pipeline import DeSplatPipelineConfig
from desplat_ns.training.trainer import DeSplatTrainerConfig

STEPS = 30_000
"""Length of the full schedule, B.3."""

FULL_RATE_VISITS, SETTLING = 150.0, 0.2
"""Visits of each photo for which Splatfacto's learning rates are right, and the share of a run in
which they fall to 0 (docs/results/speed.md, "Learning rates")."""

VISITS, QUICK_VISITS, TOURISM_VISITS = 37.5, 15.0, 75.0
"""Visits of each photo by `desplat`, `desplat-quick` and `desplat-phototourism`
(docs/results/speed.md, "How long to train")."""

PHOTO_TOURISM_STEPS, BACKGROUND_STEPS = 200_000, 100_000
"""The same for Photo Tourism, and steps at most in which the background's rates fall: as in the
authors' code."""


def _constant(lr: float) -> dict:
    return {"optimizer": FusedAdamConfig(lr=lr, eps=1e-15), "scheduler": None}


def _decaying(lr: float, lr_final: float, warmup_steps: int = 0, steps: int = STEPS) -> dict:
    decay = ExponentialDecaySchedulerConfig(
        lr_final=lr_final, max_steps=steps, warmup_steps=warmup_steps, lr_pre_warmup=0.0
    )
    return {"optimizer": FusedAdamConfig(lr=lr, eps=1e-15), "scheduler": decay}


def optimizers(steps: int) -> dict:
    """Splatfacto's (nerfstudio 1.1.5) for the static set, poses and grids; B.3's for appearance and
    background, where they are on, and our own for their cheaper grades. The rates of B.3's
    background fall in a run's `steps`, `BACKGROUND_STEPS` at most."""
    background_steps = min(steps, BACKGROUND_STEPS)
    return {
        "means": _decaying(1.6e-4, 1.6e-6),
        "features_dc": _constant(2.5e-3),
        "features_rest": _constant(2.5e-3 / 20),
        "opacities": _constant(0.05),
        "scales": _constant(5e-3),
        "quats": _constant(1e-3),
        "camera_opt": _decaying(1e-4, 5e-7, warmup_steps=1000),
        "bilateral_grid": _decaying(2e-3, 1e-4, warmup_steps=1000),
        "camera_responses": _decaying(2e-2, 5e-4),
        "background_coefficients": _decaying(1e-2, 1e-3),
        "appearance_mlp": _constant(5e-4),
        "image_embeddings": _constant(1e-3),
        "appearance_features": _constant(5e-3),
        "background_encoder": _decaying(2e-3, 1e-4, steps=background_steps),
        "background_sh_dc": _decaying(2e-3, 2e-4, steps=background_steps),
        "background_sh_rest": _decaying(1e-4, 1e-5, steps=background_steps),
    }


def desplat_model(effects: EffectsConfig) -> DeSplatModelConfig:
    """What separates, and works, in short runs as in long ones: docs/explain/separation.md says
    why, docs/results/quality.md how well."""
    return DeSplatModelConfig(
        effects=effects,
        appearance=AppearanceConfig(mlp_scale=1.0),
        distractors=DistractorConfig(
            start="residual",
            static_alone=True,
            static_warmup=None,
            lambda_d=0.1,
            initial_opacity=0.5,
            leak=0.03,
            refine_visits=5,
        ),
        first_megapixels=0.05,
        resolution_schedule=12_000,
        gaussians_per_pixel=0.05,
        opacity_prior=0.2,
        near_plane=0.2,
        long_axis_split=True,
    )


def paper_model(effects: EffectsConfig) -> DeSplatModelConfig:
    """B.3; what it has for Photo Tourism alone are the effects and the number of steps."""
    return DeSplatModelConfig(effects=effects, refine_every=100, cull_to_the_end=True)


def _method(
    name: str,
    description: str,
    model: DeSplatModelConfig,
    steps: int = STEPS,
    visits: float = 0.0,
) -> MethodSpecification:
    """A method of `steps` steps, or with `visits` as long as the photos ask for."""
    return MethodSpecification(
        config=DeSplatTrainerConfig(
            method_name=name,
            machine=MachineConfig(device_type="cuda" if torch.cuda.is_available() else "cpu"),
            max_num_iterations=0 if visits > 0 else steps,
            # the trainer says where it stands
            logging=LoggingConfig(local_writer=LocalWriterConfig(enable=False), profiler="none"),
            nominal_num_iterations=steps,
            full_rate_visits=FULL_RATE_VISITS if visits > 0 else 0.0,
            settling=SETTLING if visits > 0 else 0.0,
            visits=visits,
            steps_per_save=2000,
            steps_per_eval_batch=0,
            steps_per_eval_image=1000,  # with its picture as long as seven steps
            steps_per_eval_all_images=1000,
            pipeline=DeSplatPipelineConfig(datamanager=DeSplatDataManagerConfig(), model=model),
            optimizers=optimizers(steps),
            vis="viewer",
        ),
        description=description,
    )


SWITCHES = """

What people set most (docs/guides/training.md); the other desplat methods take it too:
  --data FOLDER           the capture
  --budget 10min          wall time of the whole run
  --max-num-iterations N  or its steps; else they follow from the photos
  --timestamp run         a fixed name of the run's folder
  --vis tensorboard       ends by itself; the viewer waits for Ctrl+C
  --load-dir FOLDER       goes on from a run's nerfstudio_models
  --pipeline.model.effects.distractors False
  --pipeline.model.effects.appearance off|camera|affine|sh
  --pipeline.model.effects.background off|constant|sh|image
  --pipeline.model.backend auto|gsplat|numba|torch

After these, what the photos are: colmap --downscale-factor 2 --masks-path masks"""

desplat = _method(
    "desplat",
    "DeSplat: a clean static scene from photos with things in the way, on GPU or CPU." + SWITCHES,
    desplat_model(EffectsConfig(auto=True)),
    visits=VISITS,
)

desplat_quick = _method(
    "desplat-quick",
    "DeSplat for a first look: 15 visits of each photo, 600 steps for 40; minutes on a laptop.",
    desplat_model(EffectsConfig(auto=True)),
    visits=QUICK_VISITS,
)

desplat_paper = _method(
    "desplat-paper",
    "DeSplat with the settings of the paper (App. B.3), to compare with.",
    paper_model(EffectsConfig()),
)

desplat_phototourism = _method(
    "desplat-phototourism",
    "DeSplat for tourists' photos: `desplat` with light and sky of each photo's own.",
    desplat_model(EffectsConfig(appearance="affine", background="image")),
    visits=TOURISM_VISITS,
)

desplat_phototourism_paper = _method(
    "desplat-phototourism-paper",
    "DeSplat with the paper's settings for Photo Tourism (App. B.3), to compare with.",
    paper_model(EffectsConfig(appearance="affine", background="image")),
    steps=PHOTO_TOURISM_STEPS,
)

desplat_phototourism_a_paper = _method(
    "desplat-phototourism-a-paper",
    "As desplat-phototourism-paper, with the appearance model alone (DeSplat-A).",
    paper_model(EffectsConfig(appearance="affine")),
    steps=PHOTO_TOURISM_STEPS,
)
