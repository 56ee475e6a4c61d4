"""Which photos of a RobustNeRF-style capture train and which are held out.

The file name says what a photo shows: `clean` (the scene alone), `clutter` (with distractors) or
`extra` (held out, for evaluation). `clean_0001` and `clutter_0001` are twins: two photos of one
viewpoint. Folders do not count. A training photo whose name says nothing is taken for cluttered.
"""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Literal

from desplat_ns.console import list_names
from desplat_ns.data.checks import read_lines
from desplat_ns.errors import CaptureError, ConfigError

Kind = Literal["clean", "clutter", "extra"]


def kind_of(name: str) -> Kind:
    """What a photo shows, from its file name; upper and lower case are the same."""
    stem = Path(name).stem.lower()
    if "extra" in stem:
        return "extra"
    return "clean" if "clean" in stem and "clutter" not in stem else "clutter"


def viewpoint_of(name: str) -> str:
    """What twins share: what follows the word in the file name, else what precedes it."""
    stem = Path(name).stem.lower()
    match = re.search(r"clean|clutter|extra", stem)
    if match is None:
        return stem
    before, after = (part.strip("_-. ") for part in (stem[: match.start()], stem[match.end() :]))
    return after or before


def evaluation_views(names: Sequence[str]) -> list[int]:
    """Indices of the held-out photos."""
    return [i for i, name in enumerate(names) if kind_of(name) == "extra"]


def views_by_ratio(names: Sequence[str], ratio: float, seed: int) -> list[int]:
    """Training photos, each viewpoint once: the fraction `ratio` cluttered, the rest clean.

    Of the viewpoints that have both twins, round(ratio * n) are taken cluttered and the others
    clean. Of those that have one photo only, round(ratio * n) of the cluttered and
    round((1 - ratio) * n) of the clean ones are taken. The order in which viewpoints turn cluttered
    depends on `seed` alone: a larger ratio keeps those of a smaller one.

    Raises:
        ConfigError: `ratio` lies outside [0, 1].
    """
    if not 0.0 <= ratio <= 1.0:
        raise ConfigError(
            f"--train-split-clean-clutter-ratio is {ratio}; it must lie between 0 (only clean) and "
            "1 (only clutter)."
        )
    clean, clutter = _by_viewpoint(names, "clean"), _by_viewpoint(names, "clutter")
    twins = shuffled(clean.keys() & clutter.keys(), seed)
    num_cluttered = round(ratio * len(twins))
    picked = [clutter[key] for key in twins[:num_cluttered]]
    picked += [clean[key] for key in twins[num_cluttered:]]
    for one_sort, share in ((clutter, ratio), (clean, 1.0 - ratio)):
        singles = shuffled(one_sort.keys() - set(twins), seed)
        picked += [one_sort[key] for key in singles[: round(share * len(singles))]]
    return sorted(i for group in picked for i in group)


def views_by_number(names: Sequence[str], num_clean: int, num_clutter: int, seed: int) -> list[int]:
    """So many clean and so many cluttered training photos, with as few twins as can be.

    Raises:
        ConfigError: negative numbers, or more than the capture has.
    """
    clean = [i for i, name in enumerate(names) if kind_of(name) == "clean"]
    clutter = [i for i, name in enumerate(names) if kind_of(name) == "clutter"]
    for option, wanted, there in (
        ("clean", num_clean, len(clean)),
        ("clutter", num_clutter, len(clutter)),
    ):
        if not 0 <= wanted <= there:
            raise ConfigError(
                f"--train-split-num-{option} is {wanted}; this capture has {there} {option} "
                f"photos. Give a number from 0 to {there}."
            )
    order = random.Random(seed)
    order.shuffle(clutter)
    order.shuffle(clean)
    picked = clutter[:num_clutter]
    taken = {viewpoint_of(names[i]) for i in picked}
    clean.sort(key=lambda i: viewpoint_of(names[i]) in taken)
    return sorted(picked + clean[:num_clean])


def views_by_file(names: Sequence[str], listing: Path) -> list[int]:
    """Training photos named in a text file, one per line; blank lines and `#` lines are skipped.

    A line is a path inside the images folder, or a file name alone where that is unambiguous.

    Raises:
        CaptureError: no such file, a line that names no photo of the reconstruction or more than
            one, or a held-out photo.
    """
    if not listing.is_file():
        raise CaptureError(
            f"The list of training photos {listing} does not exist. Name a text file with one "
            "photo per line with --train-split-file, relative to --data."
        )
    wanted = [line for line in read_lines(listing) if not line.startswith("#")]
    matches = find_photos(names, wanted)
    wrong = [line for line, where in zip(wanted, matches, strict=True) if len(where) != 1]
    if wrong:
        raise CaptureError(
            f"{len(wrong)} of {len(wanted)} lines of {listing} name no photo of the reconstruction,"
            f" or several: {list_names(wrong)}. It has {list_names(names)}."
        )
    picked = sorted({where[0] for where in matches})
    held_out = [names[i] for i in picked if kind_of(names[i]) == "extra"]
    if held_out:
        raise CaptureError(
            f"{listing} trains on photos that are held out for evaluation: {list_names(held_out)}. "
            "Remove these lines."
        )
    return picked


def find_photos(names: Sequence[str], wanted: Sequence[str]) -> list[list[int]]:
    """Indices of the photos that each entry means: the path inside the images folder or, where no
    path is so, the file name."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(PurePosixPath(name).name, []).append(i)
    places |= {name: [i] for i, name in enumerate(names)}
    return [places.get(entry, []) for entry in wanted]


def describe(names: Sequence[str]) -> str:
    """`40 clean, 40 clutter, 10 extra`: what the file names say."""
    kinds = [kind_of(name) for name in names]
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("clean", "clutter", "extra"))


def shuffled(keys: set[str], seed: int) -> list[str]:
    """The keys in an order that depends on them and on `seed` alone."""
    ordered = sorted(keys)
    random.Random(seed).shuffle(ordered)
    return ordered


def _by_viewpoint(names: Sequence[str], kind: Kind) -> dict[str, list[int]]:
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        if kind_of(name) == kind:
            groups.setdefault(viewpoint_of(name), []).append(i)
    return groups
