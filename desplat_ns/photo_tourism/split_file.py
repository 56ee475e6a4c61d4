"""Which photos of a Photo Tourism scene train and which are held out: NeRF-W's TSV, or a draw.

The TSV has one row for each photo, with the columns `filename`, `id` (the photo's number in the
reconstruction, empty where it is not in it), `split` (train or test) and `dataset` (not read).
Source: NeRF in the Wild, Martin-Brualla et al., CVPR 2021; the split files of its project page.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from desplat_ns.console import list_names
from desplat_ns.data.photo_files import find_photos, shuffled
from desplat_ns.errors import CaptureError, ConfigError

COLUMNS = ("filename", "id", "split")
"""What a split file must have, in any order and beside others."""

PATTERNS = ("*.tsv", "nerfw_split.csv")
"""Names of split files: NeRF-W's, and the same file as nerfbaselines saves it (with tabs)."""

EMPTY = {"", "nan"}
"""Values of `filename` and `id` that mean "not in the reconstruction"."""


class PhotoSplit(NamedTuple):
    """Photos by their index in the reconstruction, ascending."""

    train: list[int]
    test: list[int]


def split_files(folders: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Files in these folders with the columns of a split file, and what is wrong with others that
    have its name."""
    paths = {p.resolve(): p for f in folders for name in PATTERNS for p in sorted(f.glob(name))}
    fitting: list[Path] = []
    problems: list[str] = []
    for path in paths.values():
        try:
            read_rows(path)
            fitting.append(path)
        except CaptureError as error:
            problems.append(str(error))
    return fitting, problems


def find_split_file(folders: Sequence[Path]) -> Path | None:
    """The one split file in these folders, None where there is no file of such a name.

    Raises:
        CaptureError: several fit, or there are files of such a name and none fits.
    """
    fitting, problems = split_files(folders)
    if len(fitting) > 1:
        raise CaptureError(
            f"{len(fitting)} split files were found: {list_names(map(str, fitting))}. Say with "
            "--split-file, relative to --data, which one counts."
        )
    if not fitting and problems:
        raise CaptureError(
            f"{' '.join(problems)} Name another file with --split-file, or hold out photos that "
            "are drawn at random with --test-fraction 0.1."
        )
    return fitting[0] if fitting else None


def read_split_file(path: Path, names: Sequence[str]) -> PhotoSplit:
    """The photos that a split file lists, found among `names` (paths inside the images folder) by
    their path or, where that is unambiguous, by the file name alone. Rows without an id or a file
    name do not count.

    Raises:
        CaptureError: as `read_rows`; a split that is neither train nor test; fewer than two photos
            that train, or none for testing; rows that name no photo of the reconstruction,
            several, or one once more.
    """
    listed: dict[str, list[str]] = {"train": [], "test": []}
    for line, row in read_rows(path):
        if row["filename"].lower() in EMPTY or row["id"].lower() in EMPTY:
            continue
        split = row["split"].lower()
        if split not in listed:
            raise CaptureError(
                f"Line {line} of the split file {path} gives {row['filename']} the split "
                f"'{row['split']}'; it must be train or test. To leave a photo out, delete its row."
            )
        listed[split].append(PurePosixPath(row["filename"]).as_posix())
    rows, num_train = listed["train"] + listed["test"], len(listed["train"])
    if num_train < 2 or num_train == len(rows):
        raise CaptureError(
            f"The split file {path} lists {num_train} photos to train on and "
            f"{len(rows) - num_train} to test on, of those with an id and a file name. Needed: at "
            "least two to train on and one to test on."
        )
    matches = find_photos(names, rows)
    if wrong := [name for name, where in zip(rows, matches, strict=True) if len(where) != 1]:
        raise CaptureError(
            f"{len(wrong)} of {len(rows)} photos in the split file {path} are not in the "
            f"reconstruction, or not unambiguously: {list_names(wrong)}. The reconstruction has "
            f"{list_names(names)}. Take the split file that belongs to it, or delete these rows."
        )
    indices = [where[0] for where in matches]
    if twice := [names[i] for i, count in Counter(indices).items() if count > 1]:
        raise CaptureError(
            f"The split file {path} lists {len(twice)} photos more than once: {list_names(twice)}. "
            "Keep one row for each photo."
        )
    return PhotoSplit(sorted(indices[:num_train]), sorted(indices[num_train:]))


def read_rows(path: Path) -> list[tuple[int, dict[str, str]]]:
    """Line numbers and values of `COLUMNS`, stripped, missing ones empty; blank lines are skipped.

    Raises:
        CaptureError: no such file, not UTF-8, not a table, or columns that are missing.
    """
    needed = f"It must be UTF-8 text with tabs between the columns {', '.join(COLUMNS)}."
    if not path.is_file():
        raise CaptureError(
            f"There is no split file {path}; --split-file names one, relative to --data. {needed}"
        )
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, dialect="excel-tab", strict=True)
            reader.fieldnames = [(name or "").strip() for name in reader.fieldnames or []]
            if missing := [name for name in COLUMNS if name not in reader.fieldnames]:
                raise CaptureError(
                    f"The split file {path} has no column {', '.join(missing)}. {needed}"
                )
            return [
                (reader.line_num, {name: (row[name] or "").strip() for name in COLUMNS})
                for row in reader
            ]
    except (ValueError, csv.Error, OSError) as error:
        raise CaptureError(f"The split file {path} cannot be read: {error}. {needed}") from error


def draw_split(names: Sequence[str], test_fraction: float, seed: int) -> PhotoSplit:
    """Hold out round(`test_fraction` n) of n photos, at least one, and never all.

    The choice depends on the names and on `seed` alone, not on their order; a larger fraction keeps
    those of a smaller one.

    Raises:
        ConfigError: `test_fraction` is not between 0 and 1.
    """
    if not 0.0 < test_fraction < 1.0:
        raise ConfigError(
            f"--test-fraction is {test_fraction}; it must lie between 0 and 1, for example 0.1 to "
            "hold out every tenth photo."
        )
    num_test = min(max(1, round(test_fraction * len(names))), len(names) - 1)
    held_out = set(shuffled(set(names), seed)[:num_test])
    test = [i for i, name in enumerate(names) if name in held_out]
    return PhotoSplit(sorted({*range(len(names))} - {*test}), test)
