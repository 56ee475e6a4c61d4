"""RobustNeRF-style captures: clean, cluttered and held-out photos told apart by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.robustnerf_names import (
    describe,
    evaluation_views,
    views_by_file,
    views_by_number,
    views_by_ratio,
)
from desplat_ns.errors import CaptureError, ConfigError


@dataclass
class RobustNerfDataParserConfig(OwnSplitConfig):
    """COLMAP capture whose file names say `clean`, `clutter` or `extra` (held out)."""

    _target: type = field(default_factory=lambda: RobustNerfDataParser)
    train_split_mode: Literal["ratio", "number", "filename"] = "ratio"
    """How training photos are chosen: by the ratio of cluttered ones, by numbers, or from a file.
    Photos with `extra` in the file name are always the evaluation photos."""
    train_split_clean_clutter_ratio: float = 1.0
    """Ratio mode: 0 trains on clean photos only, 1 on cluttered ones only; between, each viewpoint
    is taken once, this fraction of them cluttered."""
    train_split_num_clean: int = 0
    """Number mode: so many clean photos."""
    train_split_num_clutter: int = 0
    """Number mode: so many cluttered photos."""
    train_split_file: Path | None = None
    """Filename mode: text file with one photo per line, relative to the data."""
    seed: int = 0
    """Chooses which viewpoints are cluttered (ratio mode), which photos are taken (number mode)."""
    distractor_masks_path: Path | None = Path("masks")
    """Folder of true distractor masks (white = distractor), relative to the data, if there is one.
    Evaluation compares the model's masks with them; training never sees them."""


class RobustNerfDataParser(DeSplatColmapDataParser):
    """See `RobustNerfDataParserConfig`."""

    config: RobustNerfDataParserConfig

    def views(self, names: Sequence[str], split: str) -> list[int]:
        """Indices of a split's photos.

        Raises:
            CaptureError: no photo for this split.
            ConfigError: options out of range.
        """
        picked = self._training_views(names) if split == "train" else evaluation_views(names)
        if picked:
            return picked
        given = f"{self.config.data} has {describe(names)} photos"
        if split == "train":
            raise CaptureError(
                f"No photo is left to train on: {given}. Photos with `clean` or `clutter` in the "
                "file name are needed; --train-split-clean-clutter-ratio 0 takes the clean ones, "
                "1 the cluttered ones."
            )
        raise CaptureError(
            f"No photo is left to evaluate on: {given}, names such as {names[0]}. Put `extra` into "
            "the file names of the photos to hold out (in the reconstruction, too), or use the "
            "`colmap` dataparser, which holds out every eighth photo."
        )

    def _training_views(self, names: Sequence[str]) -> list[int]:
        config = self.config
        if config.train_split_mode == "ratio":
            return views_by_ratio(names, config.train_split_clean_clutter_ratio, config.seed)
        if config.train_split_mode == "number":
            return views_by_number(
                names, config.train_split_num_clean, config.train_split_num_clutter, config.seed
            )
        if config.train_split_file is None:
            raise ConfigError(
                "--train-split-mode filename needs a list of photos: add --train-split-file FILE, "
                "a text file with one photo per line."
            )
        return views_by_file(names, config.data / config.train_split_file)


robustnerf_dataparser = DataParserSpecification(
    config=RobustNerfDataParserConfig(),
    description="RobustNeRF-style capture: clean, clutter, extra in the file names.",
)
