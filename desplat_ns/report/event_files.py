"""Numbers in TensorBoard's event files, read without TensorBoard.

A file is a row of records (TFRecord: length, its checksum, content, its checksum); the content is
an `Event` in protocol buffers' format, of which the few fields that a number needs are read.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

WALL_TIME, STEP, SUMMARY = 1, 2, 5
"""Fields of an `Event`."""
VALUE = 1
"""Field of a `Summary`, repeated."""
TAG, SIMPLE_VALUE = 1, 2
"""Fields of a `Summary.Value`."""

LENGTH, CHECKSUM = struct.Struct("<QI"), 4
DOUBLE, FLOAT = struct.Struct("<d"), struct.Struct("<f")
VARINT, EIGHT_BYTES, BYTES, FOUR_BYTES = 0, 1, 2, 5
"""How the value of a field is written."""

LONGEST = 64_000_000
"""Bytes of a record; what says that it is longer is damaged."""


@dataclass(frozen=True)
class Scalar:
    """A number that a run logged."""

    tag: str
    step: int
    value: float
    wall_time: float
    """Seconds since 1970."""


def scalars(path: Path, tags: Collection[str]) -> Iterator[Scalar]:
    """The numbers of some tags, in the order in which they were logged.

    Ends where the file is cut off or damaged.

    Raises:
        OSError: it cannot be read.
    """
    wanted = {tag: tag.encode() for tag in tags}
    with path.open("rb") as file:
        while True:
            head = file.read(LENGTH.size)
            if len(head) < LENGTH.size:
                return
            length = LENGTH.unpack(head)[0]
            if length > LONGEST:
                return
            record = file.read(length + CHECKSUM)
            if len(record) < length + CHECKSUM:
                return
            if not any(name in record for name in wanted.values()):
                continue
            try:
                yield from _of_event(record[:length], wanted)
            except (ValueError, IndexError, struct.error):
                return


def _of_event(event: bytes, wanted: Collection[str]) -> Iterator[Scalar]:
    wall_time, step, summaries = 0.0, 0, []
    for number, value in _fields(event):
        if number == WALL_TIME and isinstance(value, bytes):
            wall_time = DOUBLE.unpack(value)[0]
        elif number == STEP and isinstance(value, int):
            step = value
        elif number == SUMMARY and isinstance(value, bytes):
            summaries.append(value)
    for summary in summaries:
        for number, value in _fields(summary):
            if number == VALUE and isinstance(value, bytes):
                fields = dict(_fields(value))
                tag, figure = fields.get(TAG), fields.get(SIMPLE_VALUE)
                if isinstance(tag, bytes) and isinstance(figure, bytes) and tag.decode() in wanted:
                    yield Scalar(tag.decode(), step, FLOAT.unpack(figure)[0], wall_time)


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and value of each field. Raises ValueError or IndexError if the message is damaged."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        if kind == BYTES:
            size, at = _varint(message, at)
        elif kind in (EIGHT_BYTES, FOUR_BYTES):
            size = 8 if kind == EIGHT_BYTES else 4
        else:
            raise ValueError(f"a field of an unknown kind {kind}")
        if at + size > len(message):
            raise ValueError("a field is longer than its message")
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, the lowest first, and where the next field begins."""
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
