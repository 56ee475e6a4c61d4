"""The HTML page of a run: one file that needs no other and asks for none."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from desplat_ns.core.console import announce, list_names
from desplat_ns.core.effects import Effects
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.run_files import SURVEY, RunFiles
from desplat_ns.core.whole import plain_errors, write_whole
from desplat_ns.evaluation.config import in_words
from desplat_ns.evaluation.evaluate import gaussian_counts
from desplat_ns.tools.loading import LoadedRun, even_subset, load_run
from desplat_ns.tools.pages import fitted_into, template
from desplat_ns.tools.report.notices import Notice, notices
from desplat_ns.tools.report.pictures import ERROR_TOP, Photo, held_out_photos, training_photos
from desplat_ns.tools.report.views import disputed_places, seen_alone
from desplat_ns.tools.scene.gather import gather as scene_contents
from desplat_ns.tools.scene.page import html_of as scene_page

TEMPLATE = Path(__file__).with_name("page.html.jinja")

SOURCE_BYTES = 9_000_000
"""Of scene and pictures; text, and the scene's quotes written out, fit into the rest of 10 MB."""

SCENE_BYTES = 5_500_000
"""Of the scene, with the pictures in it."""

SURVEYED = {
    "appearance": "Appearance: a light of each photo's own",
    "background": "Background: what lies behind everything, as the sky",
}
"""What the effects are that a survey decides, in words."""

CONFIDENCE = {
    "clear": "",
    "close": " That was a close call: training with another choice may be worth a try.",
    "none": " It could not be told; this is the safe side.",
}
NO_SURVEY = "As given, or the method's default: there is no record of a survey of the photos."


class EffectReason(NamedTuple):
    """One effect of a run."""

    title: str
    """What the effect is, in words."""
    value: str
    """on, off, or the grade."""
    why: str


@dataclass(frozen=True)
class Contents:
    """All that is on a page."""

    experiment: str
    method: str
    capture: str
    """The folder that was trained on."""
    config: str
    """Path of config.yml, as a shell takes it."""
    steps: int
    num_photos: int
    """Training photos."""
    counts: Mapping[str, int | float]
    """As of `gaussian_counts`."""
    notices: Sequence[Notice]
    training: Sequence[Photo]
    held_out: Sequence[Photo]
    results: Mapping[str, Any]
    """Of the evaluation; empty without one."""
    reasons: Sequence[EffectReason]


def write_report(
    files: RunFiles, output: Path, most_training: int, most_held_out: int, with_scene: bool
) -> None:
    """Write the page of a run, and say where; arguments as of the command. Raises DeSplatError."""
    run, scene = load_run(files), ""
    contents = gather(run, most_training, most_held_out)
    if with_scene:
        try:
            shown = scene_contents(run, most_training, most_held_out)
            scene, left_out = scene_page(shown, SCENE_BYTES)
        except (CaptureError, ConfigError) as error:
            left_out = [f"left out. {error}"]
        for line in left_out:
            announce(f"The scene on the page: {line}", warning=True)
    content = html_of(contents, scene=scene).encode()
    with plain_errors(output):
        write_whole(output, content)
    announce(f"Saved the page to: {output} ({len(content) / 1e6:.1f} MB)")


def gather(run: LoadedRun, most_training: int, most_held_out: int) -> Contents:
    """All that the page of a run shows. Raises as `training_photos` and `held_out_photos`."""
    config, pipeline = run.config, run.pipeline
    model, manager = pipeline.model, pipeline.datamanager
    num_photos = len(manager.train_image_names)
    photos = list(training_photos(pipeline, even_subset(num_photos, most_training)))
    results, held_out = held_out_photos(pipeline, most_held_out)
    survey, in_the_way = read_survey(run.files.folder / SURVEY), model.photos_with_distractors()
    distractors = None if model.layer is None else model.layer.config
    disputed = disputed_places(model.means, [p.unlike for p in photos if p.unlike is not None])
    planned = None if config.budget else config.max_num_iterations
    return Contents(
        experiment=str(config.experiment_name),
        method=str(config.method_name),
        capture=str(config.pipeline.datamanager.data or ""),
        config=shlex.quote(str(run.files.config)),
        steps=run.steps,
        num_photos=num_photos,
        counts=gaussian_counts(model.gauss_params, model.distractors),
        notices=notices(run.steps, planned, photos, distractors, disputed, seen_alone(pipeline)),
        training=photos,
        held_out=held_out,
        results=results,
        reasons=effect_reasons(model.effects, survey, num_photos, in_the_way),
    )


def read_survey(path: Path) -> dict[str, Any] | None:
    """A survey's findings as they were written; None if there are none that can be read."""
    try:
        return json.loads(path.read_text("utf8"))
    except (OSError, ValueError):
        return None


def effect_reasons(
    effects: Effects, survey: Mapping[str, Any] | None, num_photos: int, in_the_way: Sequence[str]
) -> list[EffectReason]:
    """Every effect of the trained model with its reason. `survey` is what `read_survey` gave,
    `in_the_way` the names of those of the training photos that have distractors."""
    names = list_names(in_the_way) or "nothing was found in the way"
    found = f"In {len(in_the_way):,} of {num_photos:,} photos: {names}."
    value, why = ("on", found) if effects.distractors else ("off", "As given.")
    reasons = [EffectReason("Distractors: what is in the way in one photo only", value, why)]
    for effect, title in SURVEYED.items():
        grade, why = getattr(effects, effect), NO_SURVEY
        if survey is not None:
            finding = survey[effect]
            why = finding["reason"] + CONFIDENCE[finding["confidence"]]
            if finding["decision"] != grade:
                said = f"{finding['decision']}: {finding['reason']}"
                why = f"As given. The survey of the photos would have said {said}"
        reasons.append(EffectReason(title, grade, why))
    return reasons


def html_of(contents: Contents, scene: str = "") -> str:
    """The page, with that of the scene itself on top, if any. Of training photos those that
    distractors cover most come first. Raises ConfigError where there are too many pictures for
    `SOURCE_BYTES`."""
    training = sorted(contents.training, key=lambda photo: -(photo.covered or 0.0))
    photos = [*training, *contents.held_out]
    told = [one.picture for one in contents.notices if one.picture is not None]
    of_photos = [picture for photo in photos for picture in photo.pictures.values()]
    sources = iter(fitted_into([*told, *of_photos], SOURCE_BYTES - len(scene)))
    noticed = [(one, next(sources) if one.picture is not None else "") for one in contents.notices]
    shown = [(photo, {name: next(sources) for name in photo.pictures}) for photo in photos]
    return template(TEMPLATE, in_words=in_words).render(
        page=contents,
        scene=scene,
        training=shown[: len(training)],
        num_covered=sum(bool(photo.covered) for photo in training),
        held_out=shown[len(training) :],
        notices=noticed,
        error_top=f"{ERROR_TOP:.0%}",
    )
