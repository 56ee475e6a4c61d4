"""Methods and their options, as `ns-train` takes them."""

from __future__ import annotations

import copy
import importlib
from typing import Any


def method_config(method: str) -> Any:
    """A copy of a method's configuration.

    Args:
        method: a name that nerfstudio knows, or `module:attribute` of a MethodSpecification.

    Raises:
        KeyError: nerfstudio knows no method of this name.
    """
    from nerfstudio.configs.method_configs import all_methods  # takes seconds: not for `--help`

    module, _, attribute = method.partition(":")
    if attribute:
        return copy.deepcopy(getattr(importlib.import_module(module), attribute).config)
    return copy.deepcopy(all_methods[method])


def parse(method: str, options: list[str]) -> Any:
    """The configuration that `ns-train` makes of a method and options.

    Raises:
        SystemExit: an option is not understood; tyro has said which.
    """
    import tyro

    config = method_config(method)
    kind = (tyro.conf.SuppressFixed, tyro.conf.FlagConversionOff)  # as nerfstudio 1.1.5
    return tyro.cli(type(config), default=config, args=options, config=kind)
