"""How good a scene is, in words, and what would make it better; nothing is said of a good one.
Held-out photos, `images`, are the figures of each, as `pictures.held_out_photos` has them."""

from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean, median
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from torch import Tensor

from desplat_ns.core.console import list_names

BLURRED = 0.25
"""Share of the photos' finest detail in renderings, below which a scene looks blurred. Shares of
finished and unfinished runs: docs/guides/results.md, "The report"."""
FEW_PHOTOS = 8
EMPTY, VEILED = 0.05, 0.02
"""Shares of a held-out photo above which its holes, and what hangs before it, are named."""
HARDLY, LARGE = 0.001, 0.3
"""Shares of a photo. A smaller mask is nothing that was found; a larger one may be the scene."""
ALIKE, DOUBTFUL = 0.05, 0.5
"""Mean difference of the colours, in [0, 1], below which the static scene shows what a photo does;
and the share of what is masked, of all photos, from which on masks are doubtful where it does.
Shares of good and bad masks: docs/guides/results.md, "The report"."""
WORSE = 8.0
"""dB below the median from which on a held-out photo is named: 6 and 3 in two complete runs."""

Said = Iterator[tuple[str, str]]
"""What is to be said, each with its cure."""


def detail_kept(photo: UInt8[np.ndarray, "H W 3"], rendering: UInt8[np.ndarray, "H W 3"]) -> float:
    """How much of a photo's finest detail a rendering has: the energies of what is lost in half of
    the size, over one another. 1 where they are equal."""

    def energy(image: np.ndarray) -> float:
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        size = grey.shape[1] // 2, grey.shape[0] // 2
        half = cv2.resize(cv2.GaussianBlur(grey, (0, 0), 1.0), size, interpolation=cv2.INTER_AREA)
        return float(np.square(grey - cv2.resize(half, grey.shape[1::-1])).mean())

    return energy(rendering) / max(energy(photo), 1e-6)


def shown_anyway(
    photo: Float[Tensor, "H W 3"], static: Float[Tensor, "H W 3"], mask: Float[Tensor, "H W 1"]
) -> float:
    """Share of the pixels of a mask, of 0 and 1, where the static scene shows what the photo does,
    so that nothing had to be masked; 0 of an empty one."""
    alike = ((photo - static).abs().mean(dim=-1, keepdim=True) < ALIKE).to(mask)
    return float((alike * mask).sum() / mask.sum().clamp(min=1))


def found_in_words(masks: Sequence[tuple[float, float]]) -> str:
    """In how many photos something was masked, and how much of them; empty where nothing was.
    `masks`: of each photo the share that is masked, and of this share what is `shown_anyway`."""
    shares = [share for share, _ in masks if share > HARDLY]
    if not shares:
        return ""
    of = f"{len(shares)} of {len(masks)} photos"
    return f"Something in the way was masked in {of}: {fmean(shares):.1%} of their pixels."


def of_the_run(
    steps: int, planned: int, wanted: int, num_photos: int, images: Sequence[Mapping[str, Any]]
) -> Said:
    """`steps` are done of those that were `planned`, or, where a budget set the end (`planned` is
    0), of those that so many training photos ask for, `wanted`."""
    is_blurred = bool(images) and median(image["detail"] for image in images) < BLURRED
    blur = "The scene is blurred: the finest detail of the photos is missing."
    also = f" {blur}" if is_blurred else ""
    if steps < planned:
        yield (
            f"The run has {steps:,} of {planned:,} steps: it was stopped, or this is one of its "
            f"earlier checkpoints.{also}",
            "Go on: the same `desplat` command again, or `ns-train` with --load-dir and the folder "
            "of its checkpoints.",
        )
    elif not planned and 2 * steps < wanted:
        yield (
            f"The budget allowed {steps:,} of the {wanted:,} steps that {num_photos} photos ask "
            f"for.{also}",
            "Train anew with a larger --budget, or without one, into another folder.",
        )
    elif is_blurred:
        yield (
            f"{blur} Each photo was seen {steps / num_photos:.0f} times.",
            "Train anew and longer: a larger --budget, or more --max-num-iterations. If that is no "
            "help, look at the photos: shaken ones, or poses that are off, blur a scene as well.",
        )


def of_the_photos(
    num_photos: int,
    twice: Sequence[str],
    places: Sequence[Sequence[str]],
    left_out: Mapping[str, Sequence[str]],
) -> Said:
    """`twice`: held-out photos that train as well; `places`: training photos in groups that show
    nothing in common (`views.apart`); `left_out`: photos without a pose, by the reason."""
    if twice:
        yield (
            f"{len(twice)} of the held-out photos also train: their scores say nothing of new "
            "views.",
            "To score the scene, train with `colmap --eval-mode interval`, which holds out every "
            "eighth photo.",
        )
    if num_photos < FEW_PHOTOS:
        yield (
            f"{num_photos} photos are few: what one of them shows, no other may confirm.",
            f"Add photos from other places: {FEW_PHOTOS} at least, better 20.",
        )
    if len(places) > 1:
        groups = "; ".join(list_names(group, 2) for group in places)
        yield (
            f"The photos show {len(places)} places that have nothing in common: {groups}.",
            "Put the photos of each place into a folder of its own, and type "
            "`desplat FOLDER` for each.",
        )
    if lost := [name for names in left_out.values() for name in names]:
        yield (
            f"{len(lost)} photos have no pose and are not in the scene: {list_names(lost, 3)} "
            f"({next(iter(left_out))}).",
            "If they are of another place, put them into a folder of its own, and type "
            "`desplat FOLDER` for it. Else add photos between them and the others.",
        )


def of_the_masks(masks: Sequence[tuple[float, float]]) -> Said:
    """`masks`: as in `found_in_words`."""
    masked = sum(share for share, _ in masks)
    needless = sum(share * anyway for share, anyway in masks)
    large = sum(share > LARGE for share, _ in masks)
    if masks and masked <= HARDLY * len(masks):
        yield (
            "Nothing was found in the way: either nothing is, or it was missed.",
            "If you see something in the way, train longer, or with `ns-train desplat "
            "--data CAPTURE --pipeline.model.distractors.strong-excess 0.1`.",
        )
    elif needless > DOUBTFUL * masked or 2 * large > len(masks):
        why = f"in {needless / masked:.0%} of what is masked the scene looks like the photo"
        why = f"{large} of {len(masks)} photos have large masks" if 2 * large > len(masks) else why
        yield (
            f"What was found in the way is doubtful: {why}.",
            "Look at the masks of the training photos. Where they cover the scene itself, train "
            "with `ns-train desplat --data CAPTURE --pipeline.model.distractors.strong-excess "
            "0.3`, which asks for larger differences, or paint the masks by hand: "
            "docs/guides/results.md.",
        )


def of_held_out(images: Sequence[Mapping[str, Any]]) -> Said:
    usual = median(image["psnr"] for image in images) if images else 0.0
    if worse := [image["name"] for image in images if image["psnr"] < usual - WORSE]:
        yield (
            f"{len(worse)} of {len(images)} held-out photos are far worse than the others: "
            f"{list_names(worse, 3)}.",
            "Look at them: something in the way of the photo itself counts as an error. A pose "
            "that is off, or another place, is mended by leaving the photo out.",
        )
    empty, veiled = (
        max(((image.get(gap, 0.0), image["name"]) for image in images), default=(0.0, ""))
        for gap in ("empty", "veiled")
    )
    if empty[0] > EMPTY:
        yield (
            f"The scene has holes: {empty[0]:.0%} of the held-out photo {empty[1]} is empty, "
            "because hardly any training photo shows that part.",
            "Take photos from there, or look at the scene from other places only.",
        )
    if veiled[0] > VEILED:
        yield (
            f"Something hangs close before the camera in {veiled[0]:.0%} of the held-out photo "
            f"{veiled[1]}: too few training photos look through that place.",
            "Take photos from there, or train with --pipeline.model.near-plane 0.5, which leaves "
            "out what is that close in all views.",
        )
