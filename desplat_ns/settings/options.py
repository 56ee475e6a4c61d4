"""Options that are numbers: what each may be; NaN and infinity are mistakes wherever they stand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import field, fields, is_dataclass
from typing import Any

from desplat_ns.errors import ConfigError


def ranged(default: Any, interval: str) -> Any:
    """A dataclass's field that holds a number.

    Args:
        interval: what it may be, as "[0, inf)" or "(0, 1]"; see `check_ranges`.
    """
    return field(default=default, metadata={"interval": interval})


def check_ranges(config: Any, option: str = "-") -> None:
    """Make sure that every `ranged` field of a dataclass is a finite number in its interval; one
    that is None was not given.

    Args:
        option: what `config` is called on the command line, "-" for the command itself.

    Raises:
        ConfigError: names the first that is not.
    """
    check_finite_options(config, option)
    for f in fields(config):
        interval, value = f.metadata.get("interval"), getattr(config, f.name)
        if interval and value is not None and not _lies_in(value, interval):
            name = _option(option, f.name.replace("_", "-"))
            raise ConfigError(f"`{name}` is {value}; it has to be {_in_words(interval)}.")


def _lies_in(value: float | int, interval: str) -> bool:
    least, most = map(float, interval[1:-1].split(","))
    above = value > least if interval[0] == "(" else value >= least
    return above and (value < most if interval[-1] == ")" else value <= most)


def _in_words(interval: str) -> str:
    least, most = interval[1:-1].split(", ")
    if most == "inf":
        return f"above {least}" if interval[0] == "(" else f"{least} or more"
    return f"in {interval}"


def check_finite_options(config: Any, option: str = "-") -> None:
    """Make sure that no option of a configuration is NaN or infinite, in whatever it holds.

    Args:
        config: a dataclass; dataclasses, mappings and sequences inside are looked through.
        option: what its options are called on the command line, "-" for those of the command.

    Raises:
        ConfigError: names the first such option.
    """
    for name, value in _numbers(config, option):
        if not math.isfinite(value):
            name = name.replace("_", "-")
            raise ConfigError(f"`{name}` is {value}; it has to be a finite number.")


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield name, value
    elif is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            yield from _numbers(getattr(value, f.name, None), _option(name, f.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, _option(name, str(key)))
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _numbers(item, name)


def _option(name: str, part: str) -> str:
    return f"{name}-{part}" if name == "-" else f"{name}.{part}"


def option_of(name: str) -> str:
    """How a field is called on the command line: `--eval-mode` for eval_mode."""
    return f"--{name.replace('_', '-')}"
