"""Which effects a scene calls for. One that is off has no parameters and costs nothing."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

from desplat_ns.core.errors import ConfigError

AppearanceGrade = Literal["off", "camera", "affine", "sh"]
BackgroundGrade = Literal["off", "constant", "sh", "image"]


@dataclass(frozen=True)
class Effects:
    """The effects of one model, all decided."""

    distractors: bool = True
    appearance: AppearanceGrade = "off"
    background: BackgroundGrade = "off"

    @property
    def words(self) -> str:
        """Those that are on, as "distractors, appearance camera"; empty if none is."""
        on = {name: grade for name, grade in asdict(self).items() if grade not in (False, "off")}
        return ", ".join(name if grade is True else f"{name} {grade}" for name, grade in on.items())

    @property
    def image_embeddings(self) -> bool:
        """Whether an image has an embedding, which a network reads."""
        return self.appearance in ("affine", "sh") or self.background == "image"

    @property
    def image_light(self) -> bool:
        """Whether images differ in anything but what stands in the way: a test photo then has a
        light of its own, which has to be found before it can be scored."""
        return self.image_embeddings or self.appearance == "camera"

    @property
    def closed_form(self) -> bool:
        """Whether a test photo's light is found in closed form; else it takes an optimizer."""
        return self.appearance == "camera" and not self.image_embeddings


@dataclass
class EffectsConfig:
    """Switches, all in one place; the cheaper grade of an effect stands before the dearer one."""

    auto: bool = False
    """Look at the capture first and switch on what it calls for, at the least cost that explains
    it. An effect that is given here stays as it is given. On in `desplat`."""
    distractors: bool | None = None
    """Explain what stands in the way by a set of Gaussians for each training view; False
    trains the static scene alone. None: True; training decides by what it finds."""
    appearance: AppearanceGrade | None = None
    """For photos that differ in exposure, light or weather. camera: each photo has a gain for each
    channel, a gamma and a vignetting; affine: each has an embedding that scales and shifts each
    static Gaussian's colour (Eq. 6-7); sh: one that adds to their spherical harmonics
    (Splatfacto-W). None: as `auto` finds, else off."""
    background: BackgroundGrade | None = None
    """What lies behind all Gaussians, for the sky. constant: one learned colour; sh: a colour for
    each direction; image: one for each direction and photo (Eq. 8-12). None: as `auto` finds, else
    off."""

    @property
    def is_open(self) -> bool:
        """Whether a survey has to decide on light or sky."""
        return self.auto and None in (self.appearance, self.background)

    def settled(self) -> Effects:
        """The effects as they are given, else as they are by default. Raises ConfigError where
        `auto` is on, and nothing has decided yet."""
        if self.is_open:
            raise ConfigError(
                "`--pipeline.model.effects.auto` is on, but no survey has decided on the effects. "
                "Training by `ns-train` makes one; elsewhere give each effect."
            )
        return Effects(**self._given())

    def decided(self, surveyed: Effects) -> "EffectsConfig":
        """A copy in which `surveyed` stands for what is not given."""
        return EffectsConfig(**asdict(surveyed) | self._given())

    def _given(self) -> dict[str, Any]:
        """The effects that are given, by name."""
        given = {each.name: getattr(self, each.name) for each in fields(Effects)}
        return {name: value for name, value in given.items() if value is not None}
