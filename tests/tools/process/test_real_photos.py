"""Real photos of two places in one folder."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from desplat_ns.tools.process.request import Request
from lab.process import compare

pytestmark = [pytest.mark.slow, pytest.mark.real_data]

CLOSE = 0.01
"""Of the longest distance between cameras: how far a centre may be from the known one."""


def photos_of(capture: Path, first: int, last: int) -> list[Path]:
    return sorted((capture / "images").iterdir())[first:last]


def test_of_two_places_the_one_with_more_photos_is_taken_and_the_other_named(
    data_folder: Callable[[str], Path], tmp_path: Path
):
    fox, tree = data_folder("fox"), data_folder("monstree")
    (tmp_path / "photos").mkdir()
    others = photos_of(tree, 5, 13)
    for photo in [*photos_of(fox, 0, 9), *others]:
        shutil.copy(photo, tmp_path / "photos")
    out = tmp_path / "out"
    Request(tmp_path / "photos", out, effort="plain").main()
    found = json.loads((out / "process.json").read_text("utf8"))["findings"]
    assert (found["photos"], found["of"]) == (9, 17)
    ((reason, sources),) = found["left_out"].items()
    assert sources == [photo.name for photo in others] and "another model of 8" in reason
    written = {path.name for path in (out / "images").iterdir()}
    assert written == {photo.name for photo in photos_of(fox, 0, 9)}
    assert compare(out, fox / "sparse" / "0").largest < CLOSE
