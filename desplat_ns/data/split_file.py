"""Which photos of a Photo Tourism scene train and which are held out: NeRF-W's TSV, or a draw.

The TSV has one row for each photo, with the columns `filename`, `id` (the photo's number in the
reconstruction, empty where it is not in it), `split` (train or test) and `dataset` (not read).
Source: NeRF in the Wild, Martin-Brualla et al., CVPR 2021; the split files of its project page.
"""

import csv
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath

from desplat_ns.core.console import list_names
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.splits import Lists, shuffled

COLUMNS = ("filename", "id", "split")
"""What a split file must have, in any order and beside others."""

PATTERNS = ("*.tsv", "nerfw_split.csv")
"""Names of split files: NeRF-W's, and the same file as nerfbaselines saves it (with tabs)."""

TEST_FRACTION = 0.1
"""Share of photos that is held out where there is no split file."""

EMPTY = {"", "nan"}
"""Values of `filename` and `id` that mean "not in the reconstruction"."""


def split_files(folders: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Files in these folders with the columns of a split file, and all that have its name."""
    named = {p.resolve(): p for f in folders for name in PATTERNS for p in sorted(f.glob(name))}
    fitting: list[Path] = []
    for path in named.values():
        with suppress(CaptureError):
            read_rows(path)
            fitting.append(path)
    return fitting, list(named.values())


def find_split_file(folders: Sequence[Path]) -> Path | None:
    """The one split file in these folders, None where there is no file of such a name. Raises
    CaptureError where several fit, or none of those with such a name."""
    fitting, named = split_files(folders)
    if named and len(fitting) != 1:
        raise CaptureError(
            f"{len(fitting)} of the files {list_names(map(str, named))} are split files with the "
            f"columns {', '.join(COLUMNS)}; one is needed. Name it with --split-file, relative to "
            "--data."
        )
    return fitting[0] if fitting else None


def read_split_file(path: Path) -> Lists:
    """The photos that a split file lists. Rows without an id or a file name do not count. Raises
    CaptureError as `read_rows`, and of a split that is neither train nor test."""
    listed: dict[str, list[str]] = {"train": [], "test": []}
    for row in read_rows(path):
        if row["filename"].lower() in EMPTY or row["id"].lower() in EMPTY:
            continue
        split = row["split"].lower()
        if split not in listed:
            raise CaptureError(
                f"The split file {path} gives {row['filename']} the split '{row['split']}'; it "
                "must be train or test. To leave a photo out, delete its row."
            )
        listed[split].append(PurePosixPath(row["filename"]).as_posix())
    return listed


def read_rows(path: Path) -> list[dict[str, str]]:
    """Values of `COLUMNS`, stripped, missing ones empty; blank lines are skipped. Raises
    CaptureError where there is no such file, it is no table in UTF-8, or columns are missing."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, dialect="excel-tab", strict=True)
            reader.fieldnames = [(name or "").strip() for name in reader.fieldnames or []]
            if missing := [name for name in COLUMNS if name not in reader.fieldnames]:
                raise ValueError(f"it has no column {', '.join(missing)}")
            return [{name: (row[name] or "").strip() for name in COLUMNS} for row in reader]
    except (ValueError, csv.Error, OSError) as error:
        raise CaptureError(
            f"The split file {path} cannot be read: {error}. It must be UTF-8 text with tabs "
            f"between the columns {', '.join(COLUMNS)}. --split-file names it, relative to --data."
        ) from error


def draw_split(names: Sequence[str]) -> Lists:
    """Hold out a tenth of the photos, at least one, and never all, by their names alone."""
    num_test = min(max(1, round(TEST_FRACTION * len(names))), len(names) - 1)
    drawn = shuffled(names)
    return {"train": drawn[num_test:], "test": drawn[:num_test]}
