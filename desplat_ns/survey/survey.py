"""The survey of a capture: one function, from the files to the findings."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.errors import CaptureError
from desplat_ns.survey.background import background_finding, skies_of
from desplat_ns.survey.capture import Capture
from desplat_ns.survey.distractors import (
    Disagreement,
    compare_photos,
    distractor_figures,
    distractor_finding,
)
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.light import appearance_finding
from desplat_ns.survey.matching import matched_points
from desplat_ns.survey.observations import Observations, observe
from desplat_ns.survey.photo_light import PhotoLight, fit_light
from desplat_ns.survey.sky import Sky


@dataclass(frozen=True)
class Evidence:
    """What the findings were made from, for pictures."""

    seen: Observations
    light: PhotoLight
    disagreement: Disagreement
    skies: dict[int, Sky]


def survey(capture: Capture) -> tuple[Survey, Evidence]:
    """Look at the training photos and say which effects they call for, and by what.

    Raises:
        CaptureError: no photo, or one that cannot be read or does not fit its camera.
    """
    if len(capture.photos) == 0:
        raise CaptureError(
            "There is no training photo to survey. Check --data and the options of the split."
        )
    seen = observe(capture)
    if not seen.has_tracks:
        seen.is_tracked = matched_points(seen)
    light = fit_light(seen)
    disagreement = compare_photos(seen, light)
    appearance = appearance_finding(seen, light, disagreement.disagrees)
    distractors = distractor_finding(seen, distractor_figures(seen, disagreement))
    skies = skies_of(seen)
    background = background_finding(seen, light, skies, appearance.decision == "affine")
    found = Survey(
        appearance=appearance,
        background=background,
        distractors=distractors,
        num_photos=seen.num_photos,
        num_surveyed=len(seen.views),
        num_points=len(seen.xyz),
        notes=_notes(seen),
    )
    return found, Evidence(seen, light, disagreement, skies)


def _notes(seen: Observations) -> tuple[str, ...]:
    notes = []
    if len(seen.all_xyz) == 0:
        notes.append("The capture has no points: nothing could be compared, safe sides are taken.")
    elif not seen.has_tracks:
        notes.append(
            "The capture has no tracks: points that neighbours show alike stand for observed ones."
        )
    if len(seen.views) < seen.num_photos:
        notes.append(f"{len(seen.views)} photos, evenly spread, stand for all.")
    return tuple(notes)
