from __future__ import annotations

from collections import namedtuple

import pytest

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.fetch import download as downloads
from desplat_ns.fetch.download import download
from tests.fetch.server import Site, serving

CONTENT = bytes(range(256)) * 40_000  # ten chunks


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_arrives_whole_and_is_counted(tmp_path):
    progress = []
    with serving(Site(CONTENT)) as site:
        path = download(
            site.address, tmp_path / "a" / "data.zip", progress=lambda *at: progress.append(at)
        )
    assert path.read_bytes() == CONTENT and names(path.parent) == ["data.zip"]
    assert progress[-1] == (len(CONTENT), len(CONTENT))


def test_a_connection_that_breaks_is_taken_up_where_it_broke(tmp_path):
    with serving(Site(CONTENT, breaks_after=[3_000_000, 2_000_000])) as site:
        path = download(site.address, tmp_path / "data.zip")
    assert path.read_bytes() == CONTENT
    first, *later = site.asked
    assert first is None and len(later) == 2
    starts = [int((asked or "").removeprefix("bytes=").rstrip("-")) for asked in later]
    assert 0 < starts[0] <= 3_000_000 < starts[1] <= 5_000_000


def test_a_later_call_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(downloads, "ATTEMPTS", 1)
    with serving(Site(CONTENT, breaks_after=[3_000_000])) as site:
        with pytest.raises(CaptureError, match=r"MB are there and are kept"):
            download(site.address, tmp_path / "data.zip")
        assert names(tmp_path) == ["data.zip.part", "data.zip.part.json"]
        download(site.address, tmp_path / "data.zip")
    assert (tmp_path / "data.zip").read_bytes() == CONTENT and site.asked[1] != "bytes=0-"
    assert names(tmp_path) == ["data.zip"]


@pytest.mark.parametrize("ranges", [True, False])
def test_another_file_by_then_is_fetched_from_its_beginning(tmp_path, monkeypatch, ranges):
    monkeypatch.setattr(downloads, "ATTEMPTS", 1)
    with serving(Site(CONTENT, breaks_after=[3_000_000], ranges=ranges)) as site:
        with pytest.raises(CaptureError):
            download(site.address, tmp_path / "data.zip")
        site.content, site.version = CONTENT[::-1], '"2"'
        download(site.address, tmp_path / "data.zip")
    assert (tmp_path / "data.zip").read_bytes() == CONTENT[::-1]


def test_a_whole_part_needs_nothing_more(tmp_path, monkeypatch):
    monkeypatch.setattr(downloads.Part, "finish", lambda part: None)
    with serving(Site(CONTENT)) as site:
        download(site.address, tmp_path / "data.zip")
        monkeypatch.undo()
        download(site.address, tmp_path / "data.zip")
    assert (tmp_path / "data.zip").read_bytes() == CONTENT and len(site.asked) == 2


def test_a_file_that_is_shorter_than_it_should_be_is_not_taken(tmp_path):
    with serving(Site(CONTENT, claims_more=10)) as site, pytest.raises(CaptureError, match="go on"):
        download(site.address, tmp_path / "data.zip")
    assert not (tmp_path / "data.zip").exists()


def test_a_server_that_is_busy_is_asked_again(tmp_path):
    with serving(Site(CONTENT, is_busy=2)) as site:
        download(site.address, tmp_path / "data.zip")
    assert (tmp_path / "data.zip").read_bytes() == CONTENT


def test_what_is_no_part_of_the_file_is_thrown_away(tmp_path, monkeypatch):
    with serving(Site(CONTENT)) as site:
        monkeypatch.setattr(downloads.Part, "finish", lambda part: None)
        download(site.address, tmp_path / "data.zip")
        monkeypatch.undo()
        monkeypatch.setattr("time.sleep", lambda seconds: None)
        with (tmp_path / "data.zip.part").open("ab") as part:
            part.write(b"more")
        download(site.address, tmp_path / "data.zip")
    assert (tmp_path / "data.zip").read_bytes() == CONTENT


def test_from_an_encrypted_address_nobody_is_led_to_one_that_is_not():
    answer = namedtuple("answer", "url history")
    plain, secret = (answer(f"{kind}://example.org/x", []) for kind in ("http", "https"))
    downloads.Part._check_encrypted("https://example.org", secret)
    downloads.Part._check_encrypted("http://example.org", plain)
    for led in (plain, answer(secret.url, [plain])):
        with pytest.raises(CaptureError, match="not encrypted"):
            downloads.Part._check_encrypted("https://example.org", led)


def test_an_address_that_has_moved_is_named(tmp_path):
    with serving(Site(CONTENT)) as site:
        address = site.address.replace("data.zip", "gone.zip")
        with pytest.raises(CaptureError, match=r"gone\.zip answers 404"):
            download(address, tmp_path / "data.zip")


def test_no_server_is_said(tmp_path):
    with serving(Site(CONTENT)) as site:
        pass
    with pytest.raises(CaptureError, match="could not be fetched"):
        download(site.address, tmp_path / "data.zip")


def test_a_disk_that_will_not_hold_it_is_said_before(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10, 0, 1_000_000))
    with serving(Site(CONTENT)) as site, pytest.raises(ConfigError, match="--folder"):
        download(site.address, tmp_path / "data.zip")
    assert not (tmp_path / "data.zip.part").exists()
