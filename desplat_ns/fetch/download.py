"""A download that goes on where it ended, and is whole or is not there."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

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


def download(address: str, target: Path, progress: Progress | None = None) -> Path:
    """Fetch a file. What is there of it from an earlier call is kept, unless the server has another
    one by now.

    Args:
        target: is not there yet; until the file is whole it is called `NAME.part`.

    Raises:
        CaptureError: the server cannot be reached, has no such file or breaks off; or what came is
            something else.
        ConfigError: the disk will not hold it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    part = Part(target)
    failed = 0
    while True:
        before = part.size
        try:
            part.go_on(address, progress or (lambda done, total: None))
            break
        except (requests.RequestException, OSError) as error:
            failed = 1 if part.size > before else failed + 1
            if not isinstance(error, requests.RequestException) or failed >= ATTEMPTS:
                raise CaptureError(_broken_off(address, part, error)) from error
            time.sleep(2.0**failed / 4)
    part.finish()
    return target


def _broken_off(address: str, part: Part, error: Exception) -> str:
    have = f"{part.size / 1e6:.1f} MB are there and are kept. " if part.size > 0 else ""
    return f"{address} could not be fetched ({error}). {have}Type the same again to go on."


class Part:
    """A file that is not whole yet, and what its server said of it."""

    def __init__(self, target: Path):
        self._target = target
        self._path = target.with_name(target.name + ".part")
        self._record = target.with_name(target.name + ".part.json")

    @property
    def size(self) -> int:
        """Bytes that are there."""
        return self._path.stat().st_size if self._path.exists() else 0

    def go_on(self, address: str, progress: Progress) -> None:
        """Fetch what is missing.

        Raises:
            CaptureError: there is no such file.
            ConfigError: there is no room for it.
            requests.RequestException: the connection broke.
            OSError: the file cannot be written.
        """
        known = self._known(address)
        if known is None:
            self.remove()
            known = {}
        headers = {"Accept-Encoding": "identity"}
        if self.size > 0:
            headers |= {"Range": f"bytes={self.size}-", "If-Range": known["version"]}
        with requests.get(address, headers=headers, stream=True, timeout=PATIENCE) as answer:
            self._check_encrypted(address, answer)
            if answer.status_code == 416:
                if self.size == known.get("bytes"):
                    return
                self.remove()
                raise requests.ConnectionError("what was there is not a part of this file")
            if answer.status_code == 429 or answer.status_code >= 500:
                raise requests.ConnectionError(f"{answer.status_code} {answer.reason}")
            if answer.status_code >= 400:
                raise CaptureError(
                    f"{address} answers {answer.status_code} {answer.reason}. The data set may "
                    "have moved: look at its page, which desplat-fetch-data names."
                )
            start = 0
            if answer.status_code == 206:
                start = self.size
                if not answer.headers.get("Content-Range", "").startswith(f"bytes {start}-"):
                    self.remove()
                    raise requests.ConnectionError("another part came than was asked for")
            self._write(address, answer, start, progress)

    @staticmethod
    def _check_encrypted(address: str, answer: Any) -> None:
        """Refuse to be led from an encrypted address to one that is not."""
        plain = [
            response.url
            for response in (*answer.history, answer)
            if not response.url.startswith("https:")
        ]
        if address.startswith("https:") and plain:
            raise CaptureError(
                f"{address} leads to {plain[0]}, which is not encrypted: anybody on the way could "
                "change the file. Look at the data set's page for another address."
            )

    def _write(
        self, address: str, answer: requests.Response, start: int, progress: Progress
    ) -> None:
        """Append what an answer brings, from a byte on."""
        total = start + int(answer.headers.get("Content-Length", 0))
        check_room(self._path.parent, total - start, "what is to come has", "--folder")
        version = answer.headers.get("ETag") or answer.headers.get("Last-Modified") or ""
        about = {"address": address, "version": version, "bytes": total}
        self._record.write_text(json.dumps(about))
        with self._path.open("ab" if start > 0 else "wb") as file:
            for chunk in answer.iter_content(CHUNK):
                file.write(chunk)
                progress(file.tell(), total)
        if total > start and self.size != total:
            raise requests.ConnectionError(f"{self.size} of {total} bytes came")

    def _known(self, address: str) -> dict[str, Any] | None:
        """What the server said when the part was begun; None if it cannot be gone on from."""
        with suppress(OSError, ValueError):
            known = json.loads(self._record.read_text())
            if known["address"] == address and known["version"]:
                return known  # type: ignore[no-any-return]
        return None

    def remove(self) -> None:
        """Forget what is there."""
        self._path.unlink(missing_ok=True)
        self._record.unlink(missing_ok=True)

    def finish(self) -> None:
        """Give the whole file its name."""
        self._path.replace(self._target)
        self._record.unlink(missing_ok=True)
