"""What a method and its options resolve to: every setting by its name, without the machine's.

A record keeps them, so that a default which was changed since then shows. Resolving reads no data.
"""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

from desplat_ns.settings.effects import EffectsConfig
from desplat_ns.studies.methods import parse

Settings = dict[str, Any]
"""JSON values by names such as `pipeline.model.distractors.lambda_d`."""

NO_SETTINGS = {
    *("data", "output_dir", "experiment_name", "project_name", "timestamp", "relative_model_dir"),
    *("load_dir", "load_step", "load_config", "load_checkpoint", "load_scheduler", "prompt"),
    *("steps_per_save", "save_only_latest_checkpoint", "logging", "log_gradients"),
    *("steps_per_eval_batch", "steps_per_eval_image", "steps_per_eval_all_images"),
    *("viewer", "vis", "start_paused", "photo_memory"),
    "machine",
}
"""Fields, at any depth, that no figure depends on or that differ from computer to computer. The
seed, a field of `machine`, is the run's."""

SCENE = "scene."
"""Begins the names of what a run's scene is, `Capture.describe`."""

EFFECTS = "pipeline.model.effects."
"""Begins the names of the switches."""

OF_EFFECTS: Mapping[str, tuple[str, ...]] = {
    "distractors": ("pipeline.model.distractors.",),
    "appearance": (
        "pipeline.model.appearance.",
        "optimizers.appearance_",
        "optimizers.image_embeddings.",
        "optimizers.camera_responses.",
    ),
    "background": ("pipeline.model.background.", "optimizers.background_"),
}
"""How the names of the settings begin that matter only where an effect is on."""

DISTRACTORS = "pipeline.model.distractors."
OF_RESIDUAL = tuple(f"{DISTRACTORS}{name}_" for name in ("weak", "strong", "settled", "shared"))
"""How the names of the settings begin that matter only where distractors start by the residual."""

OF_WARMUP = tuple(f"{DISTRACTORS}{name}_" for name in ("shaping", "min_warmup", "max_warmup"))
"""The same of those that bound a warm-up, and what begins after it."""

NO_OPTION_ANY_MORE = (
    *("pipeline.model.density_control", "pipeline.model.photos_per_coefficient"),
    *("pipeline.evaluation.load_embeddings", "pipeline.evaluation.save_embeddings"),
)
"""How names begin that records have and today's settings have not: all records have the value that
is fixed now."""

CURVE_BY_NAME = ".scheduler._target"
"""How names end whose value says no more than the settings beside it: an exponential decay is the
same curve whatever class draws it."""

NEUTRAL: Mapping[str, Any] = {
    "pipeline.evaluation.lpips_net": "alex",
    "pipeline.model.near_plane": 0.2,
}
"""Settings that older code did not have, by the value with which code does what it did before. A
record that lacks such a name is not stale while today's value is this one. Enter a new setting here
only if a test holds that its value changes nothing; `near_plane` was measured instead: on the
study's captures it changes no mean PSNR by more than 0.003 dB (1,000 steps); of 18 longer runs one
changed by 0.24 dB (`around`, docs/research/separation_tried.md)."""


def settings_of(config: Any) -> Settings:
    """All settings of a configuration, its schedules settled for its number of steps; those of
    effects that are off are left out."""
    config = copy.deepcopy(config)
    if hasattr(config, "resolve_schedule_scale"):
        config.resolve_schedule_scale()
    return of_active_effects(dict(sorted(flat("", config))))


@cache
def _resolved(method: str, options: tuple[str, ...]) -> str:
    return json.dumps(settings_of(parse(method, list(options))))


def resolve(method: str, options: tuple[str, ...]) -> Settings:
    """What today's code makes of a method and options of `ns-train`; a tenth of a second each.

    Raises:
        SystemExit: see `parse`.
    """
    return json.loads(_resolved(method, options))  # as a file would give them back


def digest(settings: Settings) -> str:
    """Twelve hexadecimal digits that differ where settings do."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:12]


def differences(recorded: Settings, wanted: Settings) -> list[str]:
    """Names that are not in both, or whose values differ."""
    return sorted(
        name
        for name in recorded.keys() | wanted.keys()
        if (name in recorded, recorded.get(name)) != (name in wanted, wanted.get(name))
    )


def changes(recorded: Settings, wanted: Settings) -> list[str]:
    """Names of the settings in which a record's are not those that are wanted.

    Not counted: what belongs to an effect that is off, or that is switched itself; what the record
    lacks and `NEUTRAL` holds with the value that is wanted; and the scene, where one of the two
    does not say what it is, as records did not at first.
    """
    recorded, wanted = of_active_effects(recorded), of_active_effects(wanted)
    apart = differences(recorded, wanted)
    prefixes = [
        prefix
        for effect, names in OF_EFFECTS.items()
        if f"{EFFECTS}{effect}" in apart
        for prefix in names
    ]
    if not all(any(name.startswith(SCENE) for name in settings) for settings in (recorded, wanted)):
        prefixes.append(SCENE)
    return [
        name
        for name in apart
        if not name.startswith(tuple(prefixes))
        and (name in recorded or name not in NEUTRAL or wanted[name] != NEUTRAL[name])
    ]


def of_active_effects(settings: Settings) -> Settings:
    """Settings without those that no figure depends on: of effects that are off, of regions where
    distractors start everywhere, of the warm-up's bounds where these start at once as well, of what
    opacity costs where photos have a light of their own, visits where steps are given, and options
    that are none any more."""
    idle = NO_OPTION_ANY_MORE + tuple(
        prefix
        for effect, prefixes in OF_EFFECTS.items()
        if settings.get(f"{EFFECTS}{effect}") in (False, "off")
        for prefix in prefixes
    )
    if settings.get(f"{DISTRACTORS}start") == "everywhere":
        idle += OF_RESIDUAL
        idle += () if settings.get(f"{DISTRACTORS}static_warmup") else OF_WARMUP
    if settings.get("max_num_iterations") != 0:
        idle += ("visits",)
    if settings.get(f"{EFFECTS}appearance") not in (None, "off"):
        idle += ("pipeline.model.opacity_prior",)
    return {
        name: value
        for name, value in settings.items()
        if not name.startswith(idle) and not name.endswith(CURVE_BY_NAME)
    }


def flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Names and JSON values of everything below a value, whose own name is the first argument."""
    if isinstance(value, EffectsConfig) and not value.is_open:
        value = value.settled()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        yield from flat(name, {k: v for k, v in parts.items() if k not in NO_SETTINGS})
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from flat(f"{name}.{key}".lstrip("."), part)
    elif isinstance(value, list | tuple):
        if all(_is_plain(part) for part in value):
            yield name, list(value)
        else:
            yield from flat(name, dict(enumerate(value)))
    elif isinstance(value, Path):
        if not value.is_absolute():  # others are the machine's
            yield name, value.as_posix()
    elif isinstance(value, Enum):
        yield name, value.name
    elif _is_plain(value):
        yield name, value
    else:  # classes and functions by their names: where they are defined changes nothing
        yield name, getattr(value, "__qualname__", type(value).__qualname__)


def _is_plain(value: Any) -> bool:
    return value is None or (
        isinstance(value, bool | int | float | str) and not isinstance(value, Enum)
    )
