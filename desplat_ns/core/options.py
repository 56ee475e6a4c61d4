"""What options may be: intervals of numbers, and names. NaN and infinity are in no interval."""

from dataclasses import field, fields
from typing import Any, Literal

from desplat_ns.core.errors import ConfigError

LpipsNet = Literal["alex", "vgg"]
"""Networks of torchmetrics' LPIPS, as it calls them; Splatfacto has alex."""


def ranged(default: Any, interval: str) -> Any:
    """A dataclass's field that holds a number in an interval such as "[0, inf)" or "(0, 1]"."""
    return field(default=default, metadata={"interval": interval})


def check_ranges(config: Any, option: str = "-") -> None:
    """Raises ConfigError that names the first `ranged` field of a dataclass that is not in its
    interval; one that is None was not given. `option`: what `config` is called on the command line,
    "-" for the command itself."""
    for f in fields(config):
        interval, value = f.metadata.get("interval"), getattr(config, f.name)
        if interval and value is not None and not _lies_in(value, interval):
            name = f"{option}{'-' if option == '-' else '.'}{f.name.replace('_', '-')}"
            raise ConfigError(f"`{name}` is {value}; it has to be in {interval}.")


def _lies_in(value: float | int, interval: str) -> bool:
    least, most = map(float, interval[1:-1].split(","))
    above = value > least if interval[0] == "(" else value >= least
    return above and (value < most if interval[-1] == ")" else value <= most)


def option_of(name: str) -> str:
    """How a field is called on the command line: `--eval-mode` for eval_mode."""
    return f"--{name.replace('_', '-')}"
