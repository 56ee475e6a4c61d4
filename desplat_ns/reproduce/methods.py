"""What is trained for a table, and the paper's row that it is put beside."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.errors import ConfigError
from desplat_ns.evaluation.config import ProtocolName
from desplat_ns.reproduce.protocols import Protocol


@dataclass(frozen=True)
class Method:
    """A registered method with options."""

    name: str
    method: str
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""
    what: str
    """In words."""
    paper: str = ""
    """The row of the paper's tables that it stands beside; empty for none."""
    options: tuple[str, ...] = ()
    """Of `ns-train`."""
    has_light: bool = False
    """Whether it has an embedding for each photo."""

    def scoring(self, protocol: Protocol) -> ProtocolName:
        """How it is scored: on the protocol's pixels, whatever it has."""
        return "right" if protocol.scoring == "half" and not self.has_light else protocol.scoring


_EFFECTS = "--pipeline.model.effects"
_STATIC = (f"{_EFFECTS}.distractors", "False")
_W = (*_STATIC, f"{_EFFECTS}.appearance", "sh")
_NO_BACKGROUND = (f"{_EFFECTS}.background", "off")
_PLAIN = "Splatfacto's settings in this package: desplat-paper without distractors"
_LIT = "this package's defaults for Photo Tourism"
_B3, _B3_A = "the settings of App. B.3", "the settings of App. B.3 without the background model"
_W_WHAT = "the appearance model {} of Splatfacto-W, in this package and without its masks"
_TOURISM = "desplat-phototourism-paper"

METHODS = {
    method.name: method
    for method in (
        Method("desplat", "desplat", "this package's defaults", "DeSplat"),
        Method("desplat-paper", "desplat-paper", _B3, "DeSplat"),
        Method("splatfacto", "desplat-paper", _PLAIN, "Splatfacto", _STATIC),
        *(
            Method(name, method, what, row, options, has_light=True)
            for name, method, what, row, options in (
                ("desplat-phototourism", "desplat-phototourism", _LIT, "DeSplat", ()),
                (_TOURISM, _TOURISM, _B3, "DeSplat", ()),
                (*["desplat-phototourism-a-paper"] * 2, _B3_A, "DeSplat-A", ()),
                (
                    "splatfacto-w",
                    _TOURISM,
                    _W_WHAT.format("and the background"),
                    "Splatfacto-W",
                    _W,
                ),
                (
                    *("splatfacto-w-a", _TOURISM, _W_WHAT.format("alone"), "Splatfacto-W-A"),
                    (*_W, *_NO_BACKGROUND),
                ),
            )
        ),
    )
}


def method_of(name: str) -> Method:
    """A method of the table above, or one that is named as `module:attribute`.

    Raises:
        ConfigError: it is neither.
    """
    if name in METHODS:
        return METHODS[name]
    if ":" not in name:
        raise ConfigError(
            f"--methods names '{name}'. There are: {', '.join(METHODS)}; another one is named as "
            "module:attribute of its MethodSpecification."
        )
    return Method(name.replace(":", "."), name, f"the method {name}")
