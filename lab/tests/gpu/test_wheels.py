from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from lab.documents import CHECKOUT
from lab.gpu import wheels

CONSTRAINTS = """# a comment
Av==17.1.0 ; python_version < '3.11'
av==18.1.0 ; python_version >= '3.11'
pytorch_msssim==1.0.0
exceptiongroup==1.3.1 ; python_version < '3.11'
"""


@pytest.mark.parametrize(
    ("python", "versions"),
    [
        ("3.10", {"av": "17.1.0", "pytorch-msssim": "1.0.0", "exceptiongroup": "1.3.1"}),
        ("3.11", {"av": "18.1.0", "pytorch-msssim": "1.0.0"}),
        ("3.12", {"av": "18.1.0", "pytorch-msssim": "1.0.0"}),
    ],
)
def test_versions_are_those_of_the_machines_python(python, versions):
    assert wheels.pinned(CONSTRAINTS, python) == versions


def test_every_line_of_the_constraints_is_understood():
    text = (CHECKOUT / "constraints.txt").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    old, new = wheels.pinned(text, "3.10"), wheels.pinned(text, "3.12")
    marked = [line for line in lines if ";" in line]
    assert len(old.keys() | new.keys()) == len({line.partition("==")[0] for line in lines})
    assert marked and all("python_version" in line for line in marked)


def test_all_that_travels_has_a_version():
    known = wheels.pinned((CHECKOUT / "constraints.txt").read_text(), "3.12")
    free = {name for name in wheels.NEEDED if wheels.canonical(name) not in known}
    assert free == {"editables", "setuptools"}


def test_nothing_travels_twice_or_although_it_is_left_out():
    assert len(set(wheels.NEEDED)) == len(wheels.NEEDED)
    assert not set(wheels.NEEDED) & {*wheels.LEFT_OUT, "torch", "torchvision", "triton"}


def test_listings_of_any_kind_are_read():
    listing = "numpy==2.5.2\nOpenCV_Python.headless\n\n# said by pip\nmine @ file:///x\nscipy ; y\n"
    assert wheels.names_in(listing) == {"numpy", "opencv-python-headless", "mine", "scipy"}


def a_wheel(path: Path, lines: int = 4000) -> Path:
    """A wheel whose files are like each other, as compiled code and headers are."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for number in range(4):
            text = "\n".join(f"value_{line} = {line * 7919 % 104729}" for line in range(lines))
            file.writestr(f"thing/part_{number}.py", text)
        file.writestr(
            "thing-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: thing\nVersion: 1.0\n"
        )
        file.writestr("thing-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        file.writestr("thing-1.0.dist-info/RECORD", "")
    return path


def test_what_is_unpacked_holds_the_same_files_and_travelled_smaller(tmp_path: Path):
    wheel = a_wheel(tmp_path / "thing-1.0-py3-none-any.whl")
    archive, there = tmp_path / wheels.ARCHIVE, tmp_path / "there"
    wheels.pack([wheel], archive)
    there.mkdir()
    (unpacked,) = wheels.unpack(archive, there)
    assert unpacked.name == wheel.name and archive.stat().st_size < wheel.stat().st_size / 2
    with zipfile.ZipFile(wheel) as before, zipfile.ZipFile(unpacked) as after:
        assert after.testzip() is None
        assert {n: before.read(n) for n in before.namelist()} == {
            n: after.read(n) for n in after.namelist()
        }


def test_nothing_is_unpacked_outside_of_the_folder(tmp_path: Path):
    import io
    import tarfile

    archive, there = tmp_path / wheels.ARCHIVE, tmp_path / "there"
    there.mkdir()
    with tarfile.open(archive, "w:xz") as tar:
        entry = tarfile.TarInfo("../escaped.whl")
        entry.size = 1
        tar.addfile(entry, io.BytesIO(b"x"))
    assert wheels.unpack(archive, there) == [] and not (tmp_path / "escaped.whl").exists()


def test_the_largest_come_first():
    sizes = {"small": 100_000, "large": 59_700_000, "middle": 5_000_000}
    assert wheels.largest(sizes, 2) == ["  59.7 MB  large", "   5.0 MB  middle"]
