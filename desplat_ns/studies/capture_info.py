"""The capture that a study is of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.datamanager import DeSplatDataManagerConfig, training_split
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.settings.effects import Effects
from desplat_ns.studies.methods import parse
from desplat_ns.survey.survey import decided_effects, write_findings

METHOD = "desplat"
"""The method whose options are varied."""


@dataclass(frozen=True)
class CaptureInfo:
    """A capture, how it is read, and what it calls for."""

    data: str
    """Its folder."""
    parser: tuple[str, ...]
    """The data parser's name and options, as `ns-train` takes them; empty for the method's own."""
    photos: int
    """Of the training split."""
    held_out: int
    """Photos to score."""
    width: int
    height: int
    """Pixels of the median photo."""
    points: int
    """Of the reconstruction; 0 if it has none."""
    effects: Effects
    """As a survey decided."""

    @property
    def name(self) -> str:
        """The folder's."""
        return Path(self.data).name

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> CaptureInfo:
        """What `asdict` gave."""
        effects, parser = Effects(**content["effects"]), tuple(content["parser"])
        return cls(**content | {"effects": effects, "parser": parser})


def describe_capture(data: Path, parser: tuple[str, ...], folder: Path) -> CaptureInfo:
    """Read a capture, survey it, and say what it is.

    Args:
        folder: where the survey's findings are written.

    Raises:
        CaptureError: it cannot be read, or no photo is held out.
        SystemExit: the data parser's name or an option is not understood; tyro has said which.
    """
    data = data.resolve()
    if not data.exists():
        raise CaptureError(f"There is no folder {data}. Check the path to the capture.")
    config = parse(METHOD, ["--data", str(data), *parser])
    manager, model = config.pipeline.datamanager, config.pipeline.model
    manager.data = data
    outputs = training_split(manager)
    cameras = outputs.cameras
    held_out = _held_out(manager)
    points = outputs.metadata.get("points3D_xyz")
    effects, findings = decided_effects(model.effects, outputs)
    write_findings(findings, folder)
    return CaptureInfo(
        str(data),
        parser,
        len(cameras),
        held_out,
        int(cameras.width.median()),
        int(cameras.height.median()),
        0 if points is None else len(points),
        effects.settled(),
    )


def _held_out(manager: DeSplatDataManagerConfig) -> int:
    """How many photos there are to score. Raises CaptureError where there is none."""
    data = manager.data
    assert data is not None
    try:
        number = len(manager.settle_dataparser().setup().get_dataparser_outputs("test").cameras)
    except (IndexError, ValueError, ConfigError) as error:
        raise _nothing_to_score(data) from error
    if number == 0:
        raise _nothing_to_score(data)
    return number


def _nothing_to_score(data: Path) -> CaptureError:
    return CaptureError(
        f"No photo of {data} is held out, so that nothing can be scored. Name a data parser that "
        "holds some out, for instance: desplat-tradeoff DATA colmap --eval-mode interval "
        "--eval-interval 8."
    )
