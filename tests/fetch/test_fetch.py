from __future__ import annotations

import subprocess
import sys
import zipfile
from dataclasses import replace

import pytest

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.fetch.fetch import fetch
from desplat_ns.fetch.sources import SOURCES, File, Source
from tests.fetch.server import Site, serving


def source_at(site: Site) -> Source:
    return Source("A set: photos", "https://example.org", "set", (File(site.address),), "train")


def zipped(tmp_path, *names: str) -> bytes:
    path = tmp_path / "made.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "photo")
    return path.read_bytes()


@pytest.mark.parametrize("keep", [False, True])
def test_a_set_is_fetched_once(tmp_path, keep):
    content = zipped(tmp_path, "set/b/images/1.jpg", "set/a/dense/images/1.jpg", "set/readme.txt")
    with serving(Site(content)) as site:
        for _ in range(2):
            captures = fetch(source_at(site), tmp_path / "data", keep)
    home = tmp_path / "data" / "set"
    assert captures == [home / "a", home / "b"]
    assert len(site.asked) == 1 and (home / "data.zip").exists() is keep


def test_a_file_beside_the_archive_goes_beside_its_photos(tmp_path):
    with serving(Site(zipped(tmp_path, "set/dense/images/1.jpg"))) as site:
        split = File(site.address.replace(".zip", ".tsv"), is_archive=False)
        source = replace(source_at(site), files=(File(site.address),))
        assert fetch(source, tmp_path / "data") == [tmp_path / "data" / "set"]
        fetch(replace(source, files=(*source.files, split)), tmp_path / "data")
    assert (tmp_path / "data" / "set" / "data.tsv").read_bytes() == site.content


def test_an_archive_of_something_else_is_an_error(tmp_path):
    with (
        serving(Site(zipped(tmp_path, "set/notes.txt"))) as site,
        pytest.raises(CaptureError, match="no photos in"),
    ):
        fetch(source_at(site), tmp_path / "data")


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "data").write_text("a file")
    with pytest.raises((ConfigError, CaptureError)):
        fetch(source_at(Site(b"", address="http://127.0.0.1:9/data.zip")), tmp_path / "data")


def test_addresses_are_encrypted_and_each_set_has_a_folder_of_its_own():
    for source in SOURCES.values():
        assert all(file.address.startswith("https://") for file in source.files)
        assert source.page.startswith("https://") and "{scene}" in source.train
    assert len({source.folder for source in SOURCES.values()}) == len(SOURCES)


def test_the_command_lists_what_there_is_and_refuses_what_there_is_not():
    code = "from desplat_ns.commands.fetch_data import main; main()"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert listed.returncode == 0 and all(name in listed.stdout for name in SOURCES)
    refused = subprocess.run([sys.executable, "-c", code, "nosuch"], capture_output=True, text=True)
    assert refused.returncode != 0 and "There is no data set 'nosuch'" in refused.stderr
    assert "Traceback" not in refused.stderr
