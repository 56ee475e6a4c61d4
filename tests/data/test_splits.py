"""Photos that train are told from those that are held out by their bytes, whatever their names."""

import os
from pathlib import Path

from desplat_ns.data.splits import in_both


def test_a_photo_is_found_under_any_name_and_others_of_its_size_are_not(tmp_path: Path):
    (tmp_path / "a.jpg").write_bytes(bytes(70_000) + b"a")
    (tmp_path / "b.jpg").write_bytes(bytes(70_000) + b"b")  # as long, and begins alike
    (tmp_path / "c.jpg").write_bytes(b"c")
    (tmp_path / "copy.jpg").write_bytes(bytes(70_000) + b"a")
    os.symlink("c.jpg", tmp_path / "link.jpg")
    train = [tmp_path / name for name in ("a.jpg", "c.jpg", "missing.jpg")]
    held_out = [tmp_path / name for name in ("b.jpg", "copy.jpg", "link.jpg", "missing.jpg")]
    assert in_both(train, held_out) == ["copy.jpg (as a.jpg)", "link.jpg (as c.jpg)"]
    assert in_both(train, [tmp_path / "." / "a.jpg"]) == ["a.jpg"]
    assert in_both(train, held_out[:1]) == []
