"""The survey of a capture, from the files to the findings, and to the effects of a run; a sheet of
the evidence shows photos, the same without their light, what that leaves, and the sky."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs
from PIL import Image, ImageDraw, ImageOps

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.survey.appearance import (
    LOCAL_STEP,
    appearance_finding,
    confirmed,
    local_steps,
    matched_points,
)
from desplat_ns.survey.background import Sky, background_finding, skies_of
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Observations, observe
from desplat_ns.survey.photo_light import PhotoLight, fit_light, from_middle

LEAST_IN_VIEW, LEAST_COMPARED = 8, 50
"""Points that most photos have to show, and that a photo's brightness is compared at."""
LEAST_AGREEMENT = 0.25
"""See `_unlike`."""
MOST_COLUMNS, SIDE, HEAD = 8, 200, 18
"""Photos on the sheet; pixels of the square in which each is shown, and of the row's title."""
ROWS = (
    "photos",
    "without each photo's own light",
    f"what that leaves: green less than {LOCAL_STEP:.0%}, orange lighter, blue darker",
    "blue: nothing behind",
)
SAME, LIGHTER, DARKER, SKY = (60, 190, 90), (250, 160, 40), (40, 60, 230), (40, 110, 255)


@dataclass(frozen=True)
class Evidence:
    """What the findings were made from, for pictures. V photos, P points."""

    observations: Observations
    light: PhotoLight
    steps: Float[np.ndarray, "V P"]
    """See `local_steps`."""
    skies: dict[int, Sky]


def survey(capture: DataparserOutputs) -> tuple[Survey, Evidence]:
    """Look at the photos of the training split, and say which effects they call for and by what.

    Raises:
        CaptureError: no photo, or one that cannot be read or does not fit its camera.
    """
    if not capture.image_filenames:
        raise CaptureError(
            "There is no training photo to survey. Check --data and the options of the split."
        )
    observations = observe(capture)
    if not observations.has_tracks:
        observations.is_tracked = matched_points(observations)
    light = fit_light(observations)
    steps = local_steps(observations, light, confirmed(observations, light))
    appearance = appearance_finding(observations, light, steps)
    skies = skies_of(observations)
    background = background_finding(observations, light, skies, appearance.decision == "affine")
    findings = Survey(
        appearance=appearance,
        background=background,
        num_photos=len(capture.image_filenames),
        num_surveyed=len(observations.views),
        num_points=len(observations.xyz),
        notes=_notes(observations, len(capture.image_filenames)),
    )
    return findings, Evidence(observations, light, steps, skies)


def _notes(observations: Observations, num_photos: int) -> tuple[str, ...]:
    notes = []
    if len(observations.all_xyz) == 0:
        notes.append("The capture has no points: nothing could be compared, safe sides are taken.")
    elif not observations.has_tracks:
        notes.append(
            "The capture has no tracks: points that neighbours show alike stand for observed ones."
        )
    empty = int((observations.num_in_view < LEAST_IN_VIEW).sum())
    if len(observations.all_xyz) and 2 * empty > len(observations.views):
        notes.append(
            f"Points and cameras do not go together: in {empty} of {len(observations.views)} photos"
            f" fewer than {LEAST_IN_VIEW} of {len(observations.all_xyz)} points lie before the "
            "camera and inside of the photo. Check that both are of one reconstruction, and the "
            "poses' axes (in transforms.json y is up and -z ahead)."
        )
    elif (unlike := _unlike(observations)) > len(observations.views) / 10:
        notes.append(
            f"Photos and points do not go together: {unlike} of {len(observations.views)} photos "
            "show something else at the points than the others. Check that the photos are those of "
            "the reconstruction, neither turned nor exchanged, and the focal lengths."
        )
    if any(not mask.any() for mask in observations.allowed):
        notes.append("A mask leaves nothing of its photo: white is what may be used.")
    if len(observations.views) < num_photos:
        notes.append(f"{len(observations.views)} photos, evenly spread, stand for all.")
    return tuple(notes)


def _unlike(observations: Observations) -> int:
    """How many photos show other patches at the points than the other photos do: the cosine of a
    photo's patches and the others' sums is below `LEAST_AGREEMENT`.

    It was 0.64 and more in the median photo of nine captures, and 0.16 and less where photos were
    turned by 180 degrees or focal lengths were 1.4 times too long.
    """
    shown = observations.is_shown
    patches = observations.structures * shown[..., None]
    others = patches.sum(axis=0) - patches
    use = (shown & (shown.sum(axis=0) > 1))[..., None]
    products = [
        (use * a * b).sum(axis=(1, 2))
        for a, b in ((patches, others), (patches, patches), (others, others))
    ]
    is_compared = use.sum(axis=(1, 2)) >= LEAST_COMPARED
    return int(
        (is_compared & (products[0] < LEAST_AGREEMENT * np.sqrt(products[1] * products[2]))).sum()
    )


def decided_effects(
    effects: EffectsConfig, outputs: DataparserOutputs
) -> tuple[EffectsConfig, Survey]:
    """The effects that the training photos call for, where `effects` does not give them, and the
    findings, which are said on the console. Distractors are on unless they are given.

    Args:
        outputs: of the training split.

    Raises:
        CaptureError: no photo, or one that cannot be read or does not fit its camera.
    """
    findings, _ = survey(outputs)
    decided = effects.decided(Effects(**findings.decisions()))  # pyright: ignore[reportArgumentType]
    for line in findings.summary():
        announce(line)
    for name, value in findings.decisions().items():
        given = getattr(effects, name)
        if given not in (None, value):
            announce(f"{name}: {given}, as given; the survey would have said {value}.")
    return decided, findings


def evidence_picture(evidence: Evidence) -> Image.Image:
    """Rows as in `ROWS`; columns are photos evenly spread."""
    count = len(evidence.observations.views)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_COLUMNS)).round().astype(int))
    sheet = Image.new("RGB", (len(chosen) * SIDE, len(ROWS) * (HEAD + SIDE)), "white")
    for number, title in enumerate(ROWS):
        ImageDraw.Draw(sheet).text((4, number * (HEAD + SIDE) + 3), title, "black")
    for column, row in enumerate(chosen.tolist()):
        for number, picture in enumerate(_pictures(evidence, row)):
            small = Image.fromarray(picture)
            small = ImageOps.pad(small, (SIDE - 6, SIDE - 6), color="white", centering=(0.5, 0))
            sheet.paste(small, (column * SIDE + 3, number * (HEAD + SIDE) + HEAD))
    return sheet


def _pictures(evidence: Evidence, row: int) -> list[UInt8[np.ndarray, "H W 3"]]:
    """One photo in all `ROWS`."""
    observations, sky, steps = evidence.observations, evidence.skies.get(row), evidence.steps[row]
    photo, size = observations.photos[row], observations.views[row].size
    places = np.stack(np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5), axis=-1)
    neutral = evidence.light.neutral(row, photo / 255.0, from_middle(size, places))
    pale, radius = (photo // 2 + 110).astype(np.uint8), max(1, round(max(size) / 160))
    for at in np.flatnonzero(np.isfinite(steps)):
        color = SAME if abs(steps[at]) <= LOCAL_STEP else LIGHTER if steps[at] > 0 else DARKER
        x, y = observations.places[row, at].astype(int).tolist()
        cv2.circle(pale, (x, y), radius, color, -1, cv2.LINE_AA)
    blue = photo
    if sky is not None:
        cells = cv2.resize(sky.cells.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        blue = np.where(cells[..., None], 0.4 * photo + 0.6 * np.array(SKY), photo)
    return [photo, np.rint(neutral.clip(0, 1) * 255).astype(np.uint8), pale, blue.astype(np.uint8)]
