"""The package's own commands, one file each: options and printing only."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import tyro

from desplat_ns import __version__
from desplat_ns.core.console import announce
from desplat_ns.core.errors import ConfigError, begin_run
from desplat_ns.core.options import check_ranges, option_of
from desplat_ns.core.run_files import OUTPUTS, RunFiles, find_run, newest_run


@dataclass
class OfRun:
    """The options of a command that takes a trained run; its own have names, too."""

    load_config: Path = OUTPUTS
    """config.yml of the run, or a folder: the run in it, or below it, that was saved last is taken.
    A capture stands for its runs in `outputs`."""
    data: Path | None = None
    """Folder of the capture, if it is not where it was trained on."""

    def find(self) -> RunFiles:
        """The run's files, once the options are in their ranges. Raises DeSplatError."""
        check_ranges(self)
        config = newest_run(self.load_config)
        if config != self.load_config:
            announce(f"The run of {config}.")
        return find_run(config, self.data)


def run(command: Any, **options: Any) -> None:
    """Read a dataclass's options, or a union's, by `tyro.cli` with `options`; call its `main`."""
    name = _begin()
    _refuse_typos(command, name)
    parsed = tyro.cli(command, prog=name, **options)
    _say_what_begins(name, parsed)
    parsed.main()


def run_on_capture(command: Any, name: str) -> None:
    """As `run`, for a command whose options a data parser's name and options may follow; `main` is
    given these words. They are not looked at here: nerfstudio takes seconds to import."""
    _begin()
    options, words = split_words(command, name, sys.argv[1:])
    _say_what_begins(name, options)
    options.main(words)


def _begin() -> str:
    """The command's name; `--version` says what is installed, and ends it."""
    begin_run()
    name = Path(sys.argv[0]).name
    if "--version" in sys.argv[1:]:
        print(f"{name} {__version__}")
        raise SystemExit(0)
    return name


def _say_what_begins(name: str, options: Any) -> None:
    """In a line, by the help: what a command needs may take many seconds to import."""
    announce(f"{name}: {' '.join(str(options.__doc__).split()).partition('. ')[0].rstrip('.')}.")


def split_words(command: Any, name: str, words: Sequence[str]) -> tuple[Any, tuple[str, ...]]:
    """A command's options, and the data parser's words behind them; `--data CAPTURE`, as ns-train
    takes it, is the capture. Raises ConfigError of an option that no data parser precedes."""
    words = [word.removeprefix("--data=") for word in words if word != "--data"]
    parsed, rest = tyro.cli(command, prog=name, args=words, return_unknown_args=True)
    if rest and rest[0].startswith("-"):
        said = _no_option(rest[0], name, _options(command))
        raise ConfigError(
            f"{said} Options of a data parser follow its name, as in: {name} DATA colmap "
            "--downscale-factor 2."
        )
    return parsed, tuple(rest)


def _refuse_typos(command: Any, name: str) -> None:
    """tyro says first what is missing, and nothing of a typo. Raises ConfigError."""
    if not is_dataclass(command):
        return
    known = _options(command)
    negated = [f"--no-{option.removeprefix('--')}" for option in known]
    for word in sys.argv[1:]:
        plain = word.partition("=")[0].replace("_", "-")
        is_tyros = plain == "--help" or plain.startswith("--tyro-")
        if word.startswith("--") and not is_tyros and plain not in (*known, *negated):
            raise ConfigError(_no_option(word, name, known))


def _options(command: Any) -> list[str]:
    """A dataclass's, on the command line; not what is given by its place."""
    return [option_of(f.name) for f in fields(command) if "Positional" not in str(f.type)]


def _no_option(word: str, name: str, known: Sequence[str]) -> str:
    near = get_close_matches(word.partition("=")[0].replace("_", "-"), known, 1)
    meant = f"Did you mean {near[0]}?" if near else f"It has {', '.join(known)}."
    return f"{word} is no option of {name}. {meant}"
