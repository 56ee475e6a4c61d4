"""Why a photo was left out, as far as its features, matches and sharpness tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from desplat_ns.process.photos import Photo

BLURRED = 0.25
"""Of the median sharpness of the photos that have a pose."""
FEW_FEATURES = 0.1
"""Of the median number of features of the photos that have a pose."""


@dataclass(frozen=True)
class LeftOut:
    """A photo that has no pose, and the probable reason."""

    source: str
    reason: str


def left_out(
    photos: Sequence[Photo],
    models: Sequence[Sequence[str]],
    features: Mapping[str, int],
    pairs: Sequence[tuple[str, str, int]],
    pose_inliers: int,
) -> list[LeftOut]:
    """The photos that are not in the first model, with reasons.

    Args:
        photos: those that could be read.
        models: the copies' names in each model, the one that is taken first.
        features: of each copy.
        pairs: names of copies and their verified matches.
        pose_inliers: matches that a pose needs.
    """
    posed = set(models[0]) if models else set()
    names = {photo.copy: photo.source for photo in photos}
    best = _best_partners(pairs)
    usual_sharpness = median(p.sharpness for p in photos if p.copy in posed or not posed)
    usual_features = median(features[p.copy] for p in photos if p.copy in posed or not posed)

    def reason(photo: Photo) -> str:
        others = [model for model in models[1:] if photo.copy in model]
        if others:
            return (
                f"in another model of {len(others[0])} photos, which shares too little with the "
                "first: another place, or photos between both are missing"
            )
        said = [_matches_of(best.get(photo.copy), names, pose_inliers)]
        if photo.sharpness < BLURRED * usual_sharpness:
            said.insert(
                0, f"blurred (sharpness {photo.sharpness:.0f}, usual {usual_sharpness:.0f})"
            )
        elif features[photo.copy] < FEW_FEATURES * usual_features:
            said.insert(0, f"bare ({features[photo.copy]} features, usual {usual_features:.0f})")
        return "; ".join(said)

    return [LeftOut(p.source, reason(p)) for p in photos if p.copy not in posed]


def _best_partners(pairs: Sequence[tuple[str, str, int]]) -> dict[str, tuple[int, str]]:
    best: dict[str, tuple[int, str]] = {}
    for a, b, count in pairs:
        best[a] = max(best.get(a, (0, "")), (count, b))
        best[b] = max(best.get(b, (0, "")), (count, a))
    return best


def _matches_of(best: tuple[int, str] | None, names: Mapping[str, str], pose_inliers: int) -> str:
    if best is None:
        return "no matches with any other photo: another place, or seen from too far away"
    count, partner = best
    if count < 2 * pose_inliers:
        return f"too few matches ({count} at most, with {names[partner]})"
    return f"{count} matches with {names[partner]}, but no pose that agrees with the others"
