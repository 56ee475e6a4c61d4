"""Data sets are fetched once, and their archives put nothing elsewhere."""

import io
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.tools.fetch.fetch import fetch, unpack
from desplat_ns.tools.fetch.sources import SOURCES, Source
from tests.tools.fetch.server import Site, serving

FILES = {"set/a/images/1.jpg": b"one", "set/a/sparse/0/cameras.bin": b"two", "set/b/3.jpg": b""}


def packed(path: Path, files: Mapping[str, bytes]) -> Path:
    """A .zip or a .tar.gz."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
    else:
        with tarfile.open(path, "w:gz") as archive:
            for name, content in files.items():
                info = tarfile.TarInfo(name)
                info.size = len(content)
                archive.addfile(info, io.BytesIO(content))
    return path


def files_in(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture(params=["x.zip", "x.tar.gz"])
def archive(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / request.param


@pytest.mark.usefixtures("tars")
def test_a_folder_of_the_same_name_is_not_doubled_and_what_macos_adds_is_left_out(archive: Path):
    packed(archive, {**FILES, "__MACOSX/set/._a": b"x"})
    for name in ("set", "other"):
        unpack(archive, archive.parent / name)
    inner = {name.removeprefix("set/"): content for name, content in FILES.items()}
    assert files_in(archive.parent / "set") == inner
    assert files_in(archive.parent / "other") == FILES


@pytest.fixture(params=["today's", "3.11.2's"])
def tars(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose `tarfile` unpacks."""
    if request.param == "3.11.2's":
        monkeypatch.delattr(tarfile, "data_filter")


@pytest.mark.usefixtures("tars")
@pytest.mark.parametrize("name", ["../out.jpg", "/tmp/out-of-it.jpg", "a/../../../out.jpg"])
def test_nothing_is_written_elsewhere(archive: Path, name: str):
    packed(archive, {"fine.jpg": b"1", name: b"2"})
    try:
        unpack(archive, archive.parent / "deep" / "set")
    except CaptureError as error:
        assert archive.name in str(error)
    assert {path.name for path in archive.parent.iterdir()} <= {archive.name, "deep"}
    assert not Path("/tmp/out-of-it.jpg").exists()


@pytest.mark.usefixtures("tars")
def test_links_that_lead_elsewhere_are_refused(tmp_path: Path):
    with tarfile.open(tmp_path / "x.tar", "w") as opened:
        info = tarfile.TarInfo("link")
        info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
        opened.addfile(info)
    with pytest.raises(CaptureError, match=r"x\.tar"):
        unpack(tmp_path / "x.tar", tmp_path / "set")


def test_what_is_damaged_leaves_nothing(archive: Path):
    content = packed(archive, {"a.jpg": bytes(range(256)) * 300}).read_bytes()
    archive.write_bytes(content[: len(content) // 2])
    with pytest.raises(CaptureError, match=archive.name):
        unpack(archive, archive.parent / "set")
    assert files_in(archive.parent / "set") == {}


def test_what_is_there_is_not_replaced(archive: Path):
    (archive.parent / "set" / "a").mkdir(parents=True)
    (archive.parent / "set" / "a" / "mine.txt").write_text("mine")
    with pytest.raises(CaptureError, match="set/a"):
        unpack(packed(archive, FILES), archive.parent / "set")
    assert files_in(archive.parent / "set") == {"a/mine.txt": b"mine"}


def source_at(site: Site) -> Source:
    return Source("A set: photos", "https://example.org", "set", (site.address,), "train")


def zipped(tmp_path: Path, *names: str) -> bytes:
    return packed(tmp_path / "made.zip", dict.fromkeys(names, b"photo")).read_bytes()


def test_a_set_is_fetched_once_with_the_files_beside_its_archive(tmp_path: Path):
    content = zipped(tmp_path, "set/b/images/1.jpg", "set/a/dense/images/1.jpg", "set/readme.txt")
    with serving(Site(content)) as site:
        split = site.address.replace(".zip", ".tsv")
        source = replace(source_at(site), files=(site.address, split))
        for _ in range(2):
            captures = fetch(source, tmp_path / "data")
    home = tmp_path / "data" / "set"
    assert captures == [home / "a", home / "b"]
    assert len(site.asked) == 2 and not (home / "data.zip").exists()
    assert (home / "data.tsv").read_bytes() == content


def test_an_archive_of_something_else_and_a_folder_that_is_a_file_are_errors(tmp_path: Path):
    with serving(Site(zipped(tmp_path, "set/notes.txt"))) as site:
        with pytest.raises(CaptureError, match="example"):
            fetch(source_at(site), tmp_path / "data")
        (tmp_path / "file").write_text("a file")
        with pytest.raises((ConfigError, CaptureError)):
            fetch(source_at(site), tmp_path / "file")


def test_the_command_lists_what_there_is_and_refuses_what_there_is_not():
    code = "from desplat_ns.tools.commands.fetch_data import main; main()"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert listed.returncode == 0 and all(name in listed.stdout for name in SOURCES)
    refused = subprocess.run([sys.executable, "-c", code, "nosuch"], capture_output=True, text=True)
    assert refused.returncode != 0 and "nosuch" in refused.stderr
    assert "Traceback" not in refused.stderr
