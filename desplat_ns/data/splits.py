"""Which photos of a capture train and which are held out: the names of the photos of each split.

Whatever says so, a file, the photos' names or a draw, gives `Lists`; `listed_photos` finds them
among the photos that have a pose.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath

from desplat_ns.console import announce_once, list_names
from desplat_ns.errors import CaptureError

Lists = Mapping[str, Sequence[str]]
"""Photos by split (train, val, test): paths inside the images folder, or file names."""

LIST_FILES = {
    "train": ("train",),
    "val": ("val", "validation", "test"),
    "test": ("test", "val", "validation"),
}
"""Which `<name>_list.txt` says which photos a split has: the first that is there."""


def two_lists(train: Sequence[str], held_out: Sequence[str], source: Path | str) -> Lists:
    """Photos that train, and photos that are held out, for val and for test.

    Raises:
        CaptureError: names the photos that `source` has in both lists.
    """
    if both := {*train} & {*held_out}:
        raise CaptureError(
            f"{source} lists {len(both)} photos to train on and to hold out, too: "
            f"{list_names(sorted(both))}. Take each out of one list."
        )
    return {"train": train, "val": held_out, "test": held_out}


def read_list_files(data: Path) -> Lists:
    """What `train_list.txt`, `test_list.txt` and their like in a capture say, a name in each line;
    empty without such files."""
    lists: dict[str, list[str]] = {}
    for split, names in LIST_FILES.items():
        for path in (data / f"{name}_list.txt" for name in names):
            if split not in lists and path.is_file():
                lines = path.read_text("utf-8-sig", errors="replace").splitlines()
                lists[split] = [line.strip() for line in lines if line.strip()]
    return lists


def listed_photos(names: Sequence[str], wanted: Sequence[str], source: Path | str) -> list[int]:
    """Indices of the wanted photos among `names`, ascending. Says which are left out, as they have
    no pose or a file name that several photos have.

    An entry is the path inside the images folder or, where no path is so, the file name.

    Args:
        source: what lists them.
    """
    places: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(PurePosixPath(name).name, []).append(i)
    places |= {name: [i] for i, name in enumerate(names)}
    found = [places.get(entry, []) for entry in wanted]
    if missing := [name for name, at in zip(wanted, found, strict=True) if len(at) != 1]:
        announce_once(
            f"{len(missing)} of {len(wanted)} photos that {source} lists have no pose, or a name "
            f"that several photos have, and are left out: {list_names(missing)}.",
            warning=True,
        )
    return sorted({at[0] for at in found if len(at) == 1})


def shuffled(keys: Iterable[str], seed: int) -> list[str]:
    """The keys in an order that depends on them and on `seed` alone."""
    ordered = sorted(keys)
    random.Random(seed).shuffle(ordered)
    return ordered
