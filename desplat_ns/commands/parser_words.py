"""A data parser's name and options behind a command's own, as ns-train takes them.

Both are read in turn: the data parsers come from nerfstudio, which takes seconds to import, and
that is not needed to say what a command takes, or that a folder is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

import tyro

from desplat_ns.errors import ConfigError

if TYPE_CHECKING:
    from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

HELP = frozenset(("-h", "--help"))


Arguments = TypeVar("Arguments")


def parse(
    options: type[Arguments], command: str, words: Sequence[str]
) -> tuple[Arguments, tuple[str, ...]]:
    """A command's options, a dataclass, and the data parser's words that follow them, which are not
    looked at.

    The capture, the first word, may also stand anywhere as `--data CAPTURE`, as ns-train takes it.
    Where help is asked for it is printed, that of the data parser if one is named, and the process
    ends.

    Raises:
        ConfigError: an option is not known, and no data parser is named before it.
    """
    words = _data_first(words)
    if not HELP.isdisjoint(words):
        known, rest = [word for word in words if word not in HELP], list[str]()
        with suppress(SystemExit):  # what is wrong beside --help is not complained about
            _, rest = tyro.cli(
                options, prog=command, args=known, return_unknown_args=True, console_outputs=False
            )
        if rest and not rest[0].startswith("-"):
            data_parser(command, [rest[0], "--help"])
        tyro.cli(options, prog=command, args=["--help"])
    parsed, rest = tyro.cli(options, prog=command, args=words, return_unknown_args=True)
    if rest and rest[0].startswith("-"):
        raise ConfigError(
            f"{rest[0]} is no option of {command}; see --help. Options of a data parser follow its "
            f"name, as in: {command} DATA colmap --downscale-factor 2."
        )
    return parsed, tuple(rest)


def _data_first(words: Sequence[str]) -> list[str]:
    """The words with the capture of `--data CAPTURE` or `--data=CAPTURE` before all others."""
    for at, word in enumerate(words):
        name, is_joined, value = word.partition("=")
        if name == "--data":
            end = at + 1 if is_joined else at + 2
            data = [value] if is_joined else words[at + 1 : end]
            return [*data, *words[:at], *words[end:]]
    return list(words)


def data_parser(command: str, words: Sequence[str]) -> DataParserConfig:
    """The data parser of its name and options. Ends the process, with a list of all, where there
    is none of that name, or where it has no such options."""
    from desplat_ns.layouts.choices import AnyDataParser  # seconds

    return tyro.cli(AnyDataParser, prog=f"{command} DATA", args=list(words))
