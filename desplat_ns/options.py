"""Options that are numbers: NaN and infinity are mistakes wherever they stand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from desplat_ns.errors import ConfigError


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
