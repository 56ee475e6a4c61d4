"""Which photos of a capture train and which are held out: whatever says so, a file, the photos'
names or a draw, gives `Lists`; `listed_photos` finds them among the photos that have a pose."""

import random
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from filecmp import cmp
from pathlib import Path, PurePosixPath

from desplat_ns.core.console import announce_once, list_names

Lists = Mapping[str, Sequence[str]]
"""Photos by split (train, val, test): paths inside the images folder, or file names. Without val
it is test, and without test val."""


def in_both(train: Sequence[Path], held_out: Sequence[Path]) -> list[str]:
    """Held-out photos that also train, under whatever name: files with the same bytes, which are
    read only where sizes are the same, and up to the first that differs."""
    by_size = defaultdict(list)
    for path in filter(Path.is_file, train):
        by_size[path.stat().st_size].append(path)
    found = []
    for path in filter(Path.is_file, held_out):
        alike = by_size.get(path.stat().st_size, ())
        if twin := next((other for other in alike if cmp(path, other, shallow=False)), None):
            name = path.name
            found.append(name if name == twin.name else f"{name} (as {twin.name})")
    return sorted(found)


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
