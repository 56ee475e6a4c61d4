"""A download that goes on where it ended, and is whole or is not there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import requests

from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import check_room

ATTEMPTS = 5
"""Connections in a row that may bring nothing before it is given up."""

PATIENCE = 60
"""Seconds without a byte after which a connection counts as broken."""

CHUNK = 1 << 20
"""Bytes."""

Progress = Callable[[int, int], None]
"""Takes bytes that are there, and bytes in all."""


def download(address: str, target: Path, progress: Progress) -> None:
    """Fetch a file. What is there of it from an earlier call is kept, unless the server has another
    one by now.

    Args:
        target: is not there yet; until the file is whole it is called `NAME.part`, and
            `NAME.part.version` has what the server calls this version of it.

    Raises:
        CaptureError: the server cannot be reached, has no such file or breaks off.
        ConfigError: the disk will not hold it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(f"{target.name}.part")
    version = target.with_name(f"{target.name}.part.version")
    failed = 0
    while True:
        before = _bytes_of(part)
        try:
            _go_on(address, part, version, progress)
            break
        except (requests.RequestException, OSError) as error:
            have = _bytes_of(part)
            failed = 1 if have > before else failed + 1
            if not isinstance(error, requests.RequestException) or failed >= ATTEMPTS:
                raise CaptureError(
                    f"{address} could not be fetched ({error}). {have / 1e6:.1f} MB are there and "
                    "are kept. Type the same again to go on."
                ) from error
            time.sleep(2.0**failed / 4)
    part.replace(target)
    version.unlink(missing_ok=True)


def _bytes_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _go_on(address: str, part: Path, version: Path, progress: Progress) -> None:
    """Fetch what is missing. Raises as `download`, or requests.RequestException, OSError."""
    known = version.read_text() if version.is_file() else ""
    have = _bytes_of(part) if known else 0
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": known}
    with requests.get(address, headers=headers, stream=True, timeout=PATIENCE) as answer:
        check_encrypted(address, [response.url for response in (*answer.history, answer)])
        if answer.status_code == 416:  # what is there is not a part of the file
            part.unlink()
        if answer.status_code in (416, 429) or answer.status_code >= 500:
            raise requests.ConnectionError(f"{answer.status_code} {answer.reason}")
        if answer.status_code >= 400:
            raise CaptureError(
                f"{address} answers {answer.status_code} {answer.reason}. The data set may have "
                "moved: look at its page, which desplat-fetch-data names."
            )
        have = have if answer.status_code == 206 else 0
        left = int(answer.headers.get("Content-Length", 0))
        check_room(part.parent, left, "what is to come has", "--folder")
        version.write_text(answer.headers.get("ETag") or answer.headers.get("Last-Modified") or "")
        with part.open("ab" if have else "wb") as file:
            for chunk in answer.iter_content(CHUNK):  # raises where fewer bytes come than promised
                file.write(chunk)
                progress(file.tell(), have + left)


def check_encrypted(address: str, led_through: list[str]) -> None:
    """Raise CaptureError where an encrypted address leads to one that is not."""
    plain = [url for url in led_through if not url.startswith("https:")]
    if address.startswith("https:") and plain:
        raise CaptureError(
            f"{address} leads to {plain[0]}, which is not encrypted: anybody on the way could "
            "change the file. Look at the data set's page for another address."
        )
