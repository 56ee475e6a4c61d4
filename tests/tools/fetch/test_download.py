"""Downloads that break off, from a server on this machine."""

from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.fetch import fetch as module
from desplat_ns.tools.fetch.fetch import download
from tests.tools.fetch.server import Site, serving

CONTENT = bytes(range(256)) * 40_000  # ten chunks


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)


def fetched(site: Site, folder: Path) -> bytes:
    download(site.address, folder / "data.zip", lambda done, total: None)
    assert [path.name for path in folder.iterdir()] == ["data.zip"]
    return (folder / "data.zip").read_bytes()


def test_a_connection_that_breaks_is_taken_up_where_it_broke_and_all_is_counted(tmp_path: Path):
    progress = []
    with serving(Site(CONTENT, breaks_after=[3_000_000, 2_000_000], is_busy=2)) as site:
        download(site.address, tmp_path / "data.zip", lambda *at: progress.append(at))
    assert (tmp_path / "data.zip").read_bytes() == CONTENT
    assert progress[-1] == (len(CONTENT) // 10**6, len(CONTENT) // 10**6)
    *first, second, third = site.asked
    assert first == [None] * 3  # it was busy twice
    starts = [int((asked or "").removeprefix("bytes=").rstrip("-")) for asked in (second, third)]
    assert 0 < starts[0] <= 3_000_000 < starts[1] <= 5_000_000


@pytest.mark.parametrize("ranges", [True, False])
def test_a_later_call_goes_on(tmp_path: Path, monkeypatch, ranges: bool):
    with serving(Site(CONTENT, breaks_after=[3_000_000], ranges=ranges)) as site:
        with monkeypatch.context() as patch:
            patch.setattr(module, "ATTEMPTS", 1)
            with pytest.raises(CaptureError, match="What is there is kept"):
                fetched(site, tmp_path)
        assert fetched(site, tmp_path) == site.content
    assert site.asked[1] not in (None, "bytes=0-")


def test_what_is_no_part_of_the_file_is_thrown_away(tmp_path: Path):
    (tmp_path / "data.zip.part").write_bytes(CONTENT + b"more")
    with serving(Site(CONTENT)) as site:
        assert fetched(site, tmp_path) == CONTENT


def test_a_file_that_is_shorter_than_it_should_be_is_not_taken(tmp_path: Path):
    with serving(Site(CONTENT, claims_more=10)) as site, pytest.raises(CaptureError):
        fetched(site, tmp_path)
    assert not (tmp_path / "data.zip").exists()


def test_from_an_encrypted_address_nobody_is_led_to_one_that_is_not(tmp_path: Path, monkeypatch):
    with serving(Site(CONTENT)) as site:
        get, plain = module.requests.get, site.address
        monkeypatch.setattr(module.requests, "get", lambda _, **options: get(plain, **options))
        with pytest.raises(CaptureError, match=plain):
            download("https://example.org/data.zip", tmp_path / "data.zip", lambda *_: None)
    assert not any(tmp_path.iterdir())


def test_an_address_that_has_moved_and_a_server_that_is_gone_are_named(tmp_path: Path):
    with serving(Site(CONTENT)) as site:
        site.address = site.address.replace("data.zip", "gone.zip")
        with pytest.raises(CaptureError, match=r"gone\.zip answers 404"):
            fetched(site, tmp_path)
    with pytest.raises(CaptureError, match=r"gone\.zip"):
        fetched(site, tmp_path)
