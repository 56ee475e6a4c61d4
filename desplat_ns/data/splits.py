"""Which photos of a capture train and which are held out: whatever says so, a file, the photos'
names or a draw, gives `Lists`; `listed_photos` finds them among the photos that have a pose."""

import os
import random
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from hashlib import blake2b
from pathlib import Path, PurePosixPath
from typing import Any

from desplat_ns.core.console import announce_once, list_names

Lists = Mapping[str, Sequence[str]]
"""Photos by split (train, val, test): paths inside the images folder, or file names. Without val
it is test, and without test val."""


def in_both(train: Sequence[Path], held_out: Sequence[Path]) -> list[str]:
    """Held-out photos that also train, under whatever name: files with the same bytes. Whole files
    are read only where sizes and beginnings are the same."""
    keys: list[dict[Path, Any]] = [
        dict.fromkeys(filter(Path.is_file, s)) for s in (train, held_out)
    ]
    for key in (os.path.getsize, partial(_digest, most=1 << 16), _digest):
        keys = [{path: key(path) for path in side} for side in keys]
        both = {*keys[0].values()} & {*keys[1].values()}
        keys = [{path: k for path, k in side.items() if k in both} for side in keys]
    twins = {k: path.name for path, k in keys[0].items()}
    names = {path.name: twins[k] for path, k in keys[1].items()}
    return sorted(n if n == twin else f"{n} (as {twin})" for n, twin in names.items())


def _digest(path: Path, most: int = -1) -> bytes:
    with path.open("rb") as file:
        return blake2b(file.read(most)).digest()


def read_list_files(data: Path) -> Lists:
    """What `train_list.txt`, `test_list.txt` and `val_list.txt`, or `validation_list.txt`, in a
    capture say, a name in each line; empty without such files."""
    lists: dict[str, list[str]] = {}
    for name in ("train", "test", "validation", "val"):
        if (path := data / f"{name}_list.txt").is_file():
            lines = path.read_text("utf-8-sig", errors="replace").splitlines()
            split = "val" if name == "validation" else name
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


def shuffled(keys: Iterable[str]) -> list[str]:
    """The keys in an order that depends on them alone."""
    ordered = sorted(keys)
    random.Random(0).shuffle(ordered)
    return ordered
