"""What a run's config.yml may name. Runs are shared, and reading one makes what it names.

nerfstudio 1.1.5 writes config.yml with PyYAML's tags of Python objects and reads it by
`yaml.Loader`, which imports, calls and fills whatever a tag names: `!!python/object/apply:os.system
[...]` is run. Here the tags alone are read, before that.
"""

from __future__ import annotations

import os
from dataclasses import is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path, PurePath

import yaml

from desplat_ns.errors import ConfigError

STANDARD = "tag:yaml.org,2002:"

PLAIN = frozenset(
    ("map", "seq", "str", "int", "float", "bool", "null", "python/tuple", "python/none")
)
"""Tags that name nothing of Python's."""

PACKAGES = ("desplat_ns", "nerfstudio", "torch.optim", "pathlib")
"""Whose classes a config.yml may name, with all that is inside."""

NOT_FOR_RUNS = ("nerfstudio.scripts", "nerfstudio.process_data", "desplat_ns.commands")
"""... but for these: commands, and what calls other programs. No run is configured by them."""

VARIABLE = "DESPLAT_NS_TRUST"
"""Environment variable with further packages, separated by commas: plugins with configurations of
their own, such as a data parser."""


def check_trusted(config: Path) -> None:
    """Make sure that a config.yml names nothing but what configures a run.

    That are classes of `PACKAGES`; among them data classes to be filled, and enumerations and paths
    to be made. A function is never called. Modules of these packages are imported to tell.

    Raises:
        ConfigError: it names something else, or something that is not there.
        OSError, yaml.YAMLError: it cannot be read.
    """
    for event in yaml.parse(config.read_text("utf8"), Loader=yaml.SafeLoader):
        tag = getattr(event, "tag", None)
        if tag not in (None, "!") and not _is_trusted(config, tag):
            raise ConfigError(
                f"'{config}' names '{tag.removeprefix(STANDARD)}' in line "
                f"{event.start_mark.line + 1}. Reading the file would run it, and no run of this "
                "package needs it, so the file is not read. Do not use it unless you know who "
                "wrote it. If that is of a plugin of yours, such as a data parser, name its "
                f"package: {VARIABLE}=package."
            )


def _is_trusted(config: Path, tag: str) -> bool:
    kind, _, path = tag.removeprefix(STANDARD).partition(":")
    if not tag.startswith(STANDARD) or not path:
        return tag.startswith(STANDARD) and kind in PLAIN
    if not _is_inside(path):
        return False
    named = _named(config, path)
    if not isinstance(named, type) or not _is_inside(f"{named.__module__}.{named.__name__}"):
        return False
    if kind == "python/object":
        return is_dataclass(named)
    if kind == "python/object/apply":
        return issubclass(named, (Enum, PurePath))
    return kind == "python/name"


def _is_inside(path: str) -> bool:
    """Whether a dotted path leads into a package that is trusted."""
    more = (entry.strip() for entry in os.environ.get(VARIABLE, "").split(","))

    def one_of(packages: tuple[str, ...]) -> bool:
        return any(path.startswith(f"{package}.") for package in packages)

    return one_of((*PACKAGES, *filter(None, more))) and not one_of(NOT_FOR_RUNS)


def _named(config: Path, path: str) -> object:
    """What a dotted path names, found as PyYAML finds it: a module, and something in it."""
    module, _, name = path.rpartition(".")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise other_version(config, error) from error


def other_version(config: Path, error: Exception) -> ConfigError:
    """The error of a config.yml that names what is not here."""
    return ConfigError(
        f"'{config}' cannot be taken up ({str(error).partition(chr(10))[0]}): another version of "
        "this package, or of nerfstudio, wrote it. Use that version, or train anew."
    )
