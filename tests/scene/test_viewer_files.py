"""The libraries in the package are those that `make viewer` builds, with their licences."""

import gzip
import re
from pathlib import Path

import pytest

from desplat_ns.scene.page import VIEWER

FOLDER = VIEWER.parent
MOST = 2_000_000
"""Bytes of the wheel that the viewer may take."""

REGISTRY = re.compile(rb"registry\.|crates\.io|npmjs|pypi", re.IGNORECASE)


def test_the_viewer_is_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < MOST


def test_licences_of_all_libraries_are_beside_them():
    text = (FOLDER / "LICENSES.txt").read_text()
    for name in ("@sparkjsdev/spark", "three", "fflate"):
        assert re.search(rf"^{name} \d+\.\d+\.\d+$", text, flags=re.MULTILINE)
    assert text.count("Permission is hereby granted, free of charge") == 3


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.gz")), ids=lambda path: path.name)
def test_no_host_of_a_registry_is_named_inside(path: Path):
    assert REGISTRY.findall(gzip.decompress(path.read_bytes())) == []
