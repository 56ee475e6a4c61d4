"""The survey of a capture, from the files to the findings, and to the effects of a run."""

import numpy as np
from jaxtyping import Bool
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.core.console import announce, list_names
from desplat_ns.core.effects import Effects, EffectsConfig
from desplat_ns.core.errors import CaptureError
from desplat_ns.survey.appearance import appearance_finding, confirmed, local_steps, matched_points
from desplat_ns.survey.background import background_finding, skies_of
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Observations, observe
from desplat_ns.survey.photo_light import fit_light

LEAST_IN_VIEW, LEAST_COMPARED = 8, 50
"""Points that most photos have to show, and that a photo's brightness is compared at."""
LEAST_AGREEMENT = 0.2
MOST_CHECKED = 24
"""Photos that are compared with the points where no survey is made: a second or two."""
MASKED = "A mask leaves nothing of its photo, in {}: white is what may be used."
BEHIND = (
    f"Points and cameras do not go together: in {{}} fewer than {LEAST_IN_VIEW} points lie before "
    "the camera and inside of the photo. Check that both are of one reconstruction, and the poses' "
    "axes (in transforms.json y is up and -z ahead)."
)
UNLIKE = (
    "Photos and points do not go together: {} show something else at the points than the others. "
    "Check that the photos are those of the reconstruction, neither turned nor exchanged, and the "
    "focal lengths."
)


def survey(capture: DataparserOutputs) -> Survey:
    """Look at the photos of the training split, and say which effects they call for and by what.
    Raises CaptureError: no photo, or one that cannot be read or does not fit its camera."""
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
    is_local = appearance.decision == "affine"
    background = background_finding(observations, light, skies_of(observations), is_local)
    notes, (said, mismatch) = [], mismatches(observations)
    if len(observations.all_xyz) == 0:
        notes.append("The capture has no points: nothing could be compared, safe sides are taken.")
    elif not observations.has_tracks:
        notes.append(
            "The capture has no tracks: points that neighbours show alike stand for observed ones."
        )
    num_photos = len(capture.image_filenames)
    if len(observations.views) < num_photos:
        notes.append(f"{len(observations.views)} photos, evenly spread, stand for all.")
    return Survey(appearance, background, num_photos, (*notes, *said), mismatch)


def mismatches(observations: Observations) -> tuple[list[str], str]:
    """Sentences on photos that do not go with their masks, cameras or points, where they are more
    than a share of all; and all in one, else none, where they are more than half."""
    count = len(observations.views)
    is_judged = len(observations.all_xyz) >= LEAST_COMPARED
    kinds = [
        (MASKED, 0.0, ~np.array([mask.any() for mask in observations.allowed])),
        (BEHIND, 0.5, is_judged & (observations.num_in_view < LEAST_IN_VIEW)),
        (UNLIKE, 0.25, _unlike(observations)),
    ]
    said = []
    for sentence, share, which in kinds:
        if which.sum() > share * count:
            names = list_names((observations.names[i] for i in np.flatnonzero(which).tolist()), 3)
            said.append(sentence.format(f"{which.sum()} of {count} photos ({names})"))
    is_in_vain = 2 * np.any([which for _, _, which in kinds], axis=0).sum() > count
    return said, " ".join(said) if is_in_vain else ""


def mismatch_of(capture: DataparserOutputs) -> str:
    """What makes training useless, seen in a few photos; empty if nothing does. Raises as
    `observe`."""
    return mismatches(observe(capture, MOST_CHECKED))[1] if capture.image_filenames else ""


def refuse_mismatch(mismatch: str) -> None:
    """Raise CaptureError, with the option that accepts it, where training would be in vain."""
    if mismatch:
        raise CaptureError(
            f"{mismatch} To train all the same, add `--accept-mismatch True` (before the name of a "
            "data parser)."
        )


def _unlike(observations: Observations) -> Bool[np.ndarray, " V"]:
    """Which photos show other patches at the points than the others do: the cosine of a photo's
    patches and the others' sums is below `LEAST_AGREEMENT` (docs/explain/survey.md)."""
    shown = observations.is_shown
    patches = observations.structures * shown[..., None]
    others = patches.sum(axis=0) - patches
    use = (shown & (shown.sum(axis=0) > 1))[..., None]
    products = [
        (use * a * b).sum(axis=(1, 2))
        for a, b in ((patches, others), (patches, patches), (others, others))
    ]
    is_compared = use.sum(axis=(1, 2)) >= LEAST_COMPARED
    return is_compared & (products[0] < LEAST_AGREEMENT * np.sqrt(products[1] * products[2]))


def decided_effects(
    effects: EffectsConfig, outputs: DataparserOutputs, accept_mismatch: bool = False
) -> tuple[EffectsConfig, Survey]:
    """The effects that the training split calls for, where `effects` does not give them, and the
    findings, which are said on the console. Distractors are on unless they are given. Raises as
    `survey`, and as `refuse_mismatch` unless a mismatch is accepted."""
    findings = survey(outputs)
    refuse_mismatch("" if accept_mismatch else findings.mismatch)
    decided = effects.decided(Effects(**findings.decisions()))  # pyright: ignore[reportArgumentType]
    for line in findings.summary():
        announce(line)
    for name, value in findings.decisions().items():
        given = getattr(effects, name)
        if given not in (None, value):
            announce(f"{name}: {given}, as given; the survey would have said {value}.")
    return decided, findings
