"""`desplat-data`: the dataparser that looks at the capture and takes the one that reads it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from nerfstudio.data.dataparsers.base_dataparser import DataParser, DataParserConfig
from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.console import announce
from desplat_ns.layouts.recognition import recognise


@dataclass
class DeSplatDataParserConfig(DataParserConfig):
    """Recognises the capture's layout and takes the dataparser that reads it. Options that are not
    given are that dataparser's own; for its other options, name it instead of this one."""

    _target: type = field(default_factory=lambda: DataParser)
    data: Path = Path()
    """Folder of the capture, or its transforms.json."""
    downscale_factor: int | None = None
    """Photos at 1/N of their size. Without this option, at most 1600 pixels a side."""
    eval_mode: Literal["fraction", "filename", "interval", "all"] | None = None
    """How photos are held out for evaluation, if the layout does not say which."""
    train_split_fraction: float | None = None
    """With --eval-mode fraction: the share of photos that train."""
    eval_interval: int | None = None
    """With --eval-mode interval: every Nth photo is held out."""
    orientation_method: Literal["pca", "up", "vertical", "none"] | None = None
    """How the scene is turned upright."""
    center_method: Literal["poses", "focus", "none"] | None = None
    """What becomes the scene's centre."""
    auto_scale_poses: bool | None = None
    """Whether the cameras are scaled into a box from -1 to 1."""
    scale_factor: float | None = None
    """Scale of the cameras' positions, in addition."""
    scene_scale: float | None = None
    """Half the side of the scene's box, in scaled units."""
    load_3D_points: bool | None = None
    """Whether training starts from the reconstruction's points instead of random ones."""

    def recognised(self) -> DataParserConfig:
        """The configuration of the dataparser that reads the capture; says which and why.

        Raises:
            CaptureError: no capture is found.
            ConfigError: options that the layout has no use for.
        """
        match = recognise(self.data)
        config = match.config(self._given())
        announce(match.line())
        return config

    def setup(self, **kwargs: Any) -> Any:
        """The dataparser that reads the capture. Raises as `recognised`."""
        return self.recognised().setup(**kwargs)

    def _given(self) -> dict[str, Any]:
        names = (f.name for f in fields(self) if f.name not in ("_target", "data"))
        options = {name: getattr(self, name) for name in names}
        return {name: value for name, value in options.items() if value is not None}


desplat_dataparser = DataParserSpecification(
    config=DeSplatDataParserConfig(),
    description="Any capture: recognises its layout and takes the dataparser that reads it.",
)
