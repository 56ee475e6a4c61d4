"""What is trained for a table, and the paper's row that it is put beside."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.errors import ConfigError
from desplat_ns.evaluation.config import ProtocolName
from desplat_ns.reproduce.protocols import Protocol

EFFECTS = "--pipeline.model.effects"


@dataclass(frozen=True)
class Method:
    """A registered method with options."""

    name: str
    method: str
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""
    what: str
    """In words."""
    options: tuple[str, ...] = ()
    """Of `ns-train`."""
    paper: str = ""
    """The row of the paper's tables that it stands beside; empty for none."""
    has_light: bool = False
    """Whether it has an embedding for each photo."""

    def scoring(self, protocol: Protocol) -> ProtocolName:
        """How it is scored: on the protocol's pixels, whatever it has."""
        return "right" if protocol.scoring == "half" and not self.has_light else protocol.scoring


_STATIC = (f"{EFFECTS}.distractors", "False")
_W = (*_STATIC, f"{EFFECTS}.appearance", "sh")
_W_WHAT = "the appearance model {} of Splatfacto-W, in this package and without its masks"

METHODS = {
    method.name: method
    for method in (
        Method("desplat", "desplat", "this package's defaults", paper="DeSplat"),
        Method("desplat-paper", "desplat-paper", "the settings of App. B.3", paper="DeSplat"),
        Method(
            "splatfacto",
            "desplat-paper",
            "Splatfacto's settings in this package: desplat-paper without distractors",
            _STATIC,
            "Splatfacto",
        ),
        Method(
            "desplat-phototourism",
            "desplat-phototourism",
            "this package's defaults for Photo Tourism",
            paper="DeSplat",
            has_light=True,
        ),
        Method(
            "desplat-phototourism-paper",
            "desplat-phototourism-paper",
            "the settings of App. B.3",
            paper="DeSplat",
            has_light=True,
        ),
        Method(
            "desplat-phototourism-a-paper",
            "desplat-phototourism-a-paper",
            "the settings of App. B.3 without the background model",
            paper="DeSplat-A",
            has_light=True,
        ),
        Method(
            "splatfacto-w",
            "desplat-phototourism-paper",
            _W_WHAT.format("and the background"),
            _W,
            "Splatfacto-W",
            has_light=True,
        ),
        Method(
            "splatfacto-w-a",
            "desplat-phototourism-paper",
            _W_WHAT.format("alone"),
            (*_W, f"{EFFECTS}.background", "off"),
            "Splatfacto-W-A",
            has_light=True,
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
