"""Photo Tourism scenes: COLMAP's undistorted photos, and which of them train and are held out: by
NeRF-W's TSV, or by a draw.

The TSV has one row for each photo, with the columns `filename`, `id` (the photo's number in the
reconstruction, empty where it is not in it), `split` (train or test) and `dataset` (not read).
Source: NeRF in the Wild, Martin-Brualla et al., CVPR 2021; the split files of its project page.
"""

import csv
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.core.console import announce_once, list_names
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.splits import Lists, shuffled

DENSE = Path("dense")
"""Folder of undistorted photos and their reconstruction, side by side, in the data."""

COLUMNS = ("filename", "id", "split")
"""What a split file must have, in any order and beside others."""

TEST_FRACTION = 0.1
"""Share of photos that is held out where there is no split file."""


@dataclass
class PhotoTourismDataParserConfig(OwnSplitConfig):
    """Photo Tourism scene: dense/images, dense/sparse and NeRF-W's split file."""

    _target: type = field(default_factory=lambda: PhotoTourismDataParser)
    images_path: Path = DENSE / "images"
    """Photos, relative to the data; without this option dense/images or, where there is no
    dense/sparse, images."""
    colmap_path: Path = DENSE / "sparse"
    """Reconstruction, relative to the data; without this option dense/sparse or sparse, or the
    largest model in there (sparse/0, sparse/1, ...)."""
    split_file: Path | None = None
    """NeRF-W's split file, relative to the data: filename, id, split, with tabs between. Without
    this option the .tsv file in the data or in dense/ that has these columns."""


class PhotoTourismDataParser(DeSplatColmapDataParser):
    config: PhotoTourismDataParserConfig
    split_by = "the split file; without one a tenth is drawn for testing"

    def __init__(self, config: PhotoTourismDataParserConfig):
        """Where dense/ has no reconstruction, but the data itself has one, that is taken with the
        photos beside it; paths that the options name come before that. Photos of one place never go
        with the reconstruction of the other: in dense/ they are undistorted, outside perhaps not.
        """
        data, dense, beside = config.data, DENSE / "sparse", Path("sparse")
        is_beside = find_models(data, beside) and not find_models(data, dense)
        if config.colmap_path == dense and is_beside:
            given = config.images_path
            images = Path("images") if given == DENSE / "images" else given
            config = replace(config, images_path=images, colmap_path=beside)
        super().__init__(config)

    def lists(self, names: Sequence[str]) -> Lists:
        """By the split file, or drawn; says once how. Raises CaptureError as `find_split_file` and
        `read_split_file`."""
        data, named = self.config.data, self.config.split_file
        path = data / named if named else find_split_file(data)
        lists = read_split_file(path) if path else draw_split(names)
        how = f"by {path}" if path else "drawn, as there is no split file"
        train, test = lists["train"], lists["test"]
        announce_once(
            f"Split, {how}: of {len(names)} photos {len(train)} train, and {len(test)} are for "
            f"testing: {list_names(sorted(test))}."
        )
        return lists


# --- the split file ------------------------------------------------------------------------------


def split_files(data: Path) -> tuple[list[Path], list[Path]]:
    """Files with the columns of a split file, and all that have its name, in the data and in
    dense/; where the data is itself dense/, also one folder up."""
    folders = [data, data / DENSE, *([data / ".."] if data.resolve().name == DENSE.name else [])]
    names = ("*.tsv", "nerfw_split.csv")  # NeRF-W's, and the same as nerfbaselines saves it
    named = {p.resolve(): p for f in folders for name in names for p in sorted(f.glob(name))}
    fitting: list[Path] = []
    for path in named.values():
        with suppress(CaptureError):
            read_rows(path)
            fitting.append(path)
    return fitting, list(named.values())


def find_split_file(data: Path) -> Path | None:
    """The one of `split_files`, None where there is no file of such a name. Raises CaptureError
    where several fit, or none of those with such a name."""
    fitting, named = split_files(data)
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
        if {row["filename"].lower(), row["id"].lower()} & {"", "nan"}:  # not in the reconstruction
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


photo_tourism_dataparser = DataParserSpecification(PhotoTourismDataParserConfig())
