from __future__ import annotations

import io
import stat
import tarfile
import zipfile
from collections import namedtuple

import numpy as np
import pytest

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.fetch.archives import unpack

FILES = {"set/a/images/1.jpg": b"one", "set/a/sparse/0/cameras.bin": b"two", "set/b/3.jpg": b""}


def make_zip(path, files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def make_tar(path, files):
    with tarfile.open(path, "w:gz") as archive:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))


KINDS = {"zip": make_zip, "tar.gz": make_tar}


def files_in(folder) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_of_the_same_name_is_not_doubled(tmp_path, kind):
    archive = tmp_path / f"x.{kind}"
    KINDS[kind](archive, FILES)
    for name in ("set", "other"):
        unpack(archive, tmp_path / name)
    inner = {name.removeprefix("set/"): content for name, content in FILES.items()}
    assert files_in(tmp_path / "set") == inner
    assert files_in(tmp_path / "other") == FILES


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["../out.jpg", "/tmp/out.jpg", "a/../../out.jpg", "C:out.jpg"])
def test_nothing_is_written_elsewhere(tmp_path, kind, name):
    archive = tmp_path / f"x.{kind}"
    KINDS[kind](archive, {"fine.jpg": b"1", name: b"2"})
    with pytest.raises(CaptureError, match="outside of"):
        unpack(archive, tmp_path / "deep" / "set")
    assert [path.name for path in tmp_path.iterdir()] == [archive.name]


def test_links_are_refused(tmp_path):
    linked = tmp_path / "x.tar"
    with tarfile.open(linked, "w") as archive:
        info = tarfile.TarInfo("link")
        info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(info)
    zipped = tmp_path / "x.zip"
    with zipfile.ZipFile(zipped, "w") as archive:
        entry = zipfile.ZipInfo("link")
        entry.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(entry, "/etc/passwd")
    for path in (linked, zipped):
        with pytest.raises(CaptureError, match="is a link or a device"):
            unpack(path, tmp_path / "set")


def test_a_bomb_is_refused(tmp_path):
    archive = tmp_path / "x.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as opened:
        opened.writestr("zeros", bytes(30_000_000))
    with pytest.raises(CaptureError, match=r"would become 0\.0 GB|hardly shrink"):
        unpack(archive, tmp_path / "set")
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_damaged_leaves_nothing(tmp_path, kind):
    archive = tmp_path / f"x.{kind}"
    KINDS[kind](archive, {"a.jpg": bytes(range(256)) * 300})
    content = archive.read_bytes()
    archive.write_bytes(content[: len(content) // 2])
    with pytest.raises(CaptureError, match="fetch it again"):
        unpack(archive, tmp_path / "set")
    assert not (tmp_path / "set").exists() or files_in(tmp_path / "set") == {}


@pytest.mark.parametrize("kind", KINDS)
def test_a_byte_that_is_another_is_noticed(tmp_path, kind):
    archive = tmp_path / f"x.{kind}"
    photo = np.random.default_rng(0).integers(0, 256, 200_000, np.uint8).tobytes()
    KINDS[kind](archive, {"a.jpg": photo, "b.jpg": photo[::-1]})
    content = bytearray(archive.read_bytes())
    content[len(content) // 3] ^= 1
    archive.write_bytes(bytes(content))
    with pytest.raises(CaptureError, match="fetch it again"):
        unpack(archive, tmp_path / "set")
    assert files_in(tmp_path / "set") == {}


def test_what_macos_adds_is_left_out(tmp_path):
    archive = tmp_path / "x.zip"
    make_zip(archive, {**FILES, "__MACOSX/set/._a": b"x"})
    unpack(archive, tmp_path / "set")
    assert sorted(path.name for path in (tmp_path / "set").iterdir()) == ["a", "b"]


def test_what_is_there_is_not_replaced(tmp_path):
    archive = tmp_path / "x.zip"
    make_zip(archive, FILES)
    (tmp_path / "set" / "a").mkdir(parents=True)
    (tmp_path / "set" / "a" / "mine.txt").write_text("mine")
    with pytest.raises(CaptureError, match="is there already"):
        unpack(archive, tmp_path / "set")
    assert files_in(tmp_path / "set") == {"a/mine.txt": b"mine"}


def test_a_disk_that_will_not_hold_it_is_said_before(tmp_path, monkeypatch):
    archive = tmp_path / "x.zip"
    make_zip(archive, FILES)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10, 0, 5))
    with pytest.raises(ConfigError, match="--folder"):
        unpack(archive, tmp_path / "set")
