"""Methods, their options and captures, as `ns-train` takes them."""

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tyro
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.core.errors import CaptureError, DeSplatError


def method_config(method: str) -> Any:
    """A copy of the configuration of a method of nerfstudio's. Raises KeyError of another name."""
    return copy.deepcopy(all_methods[method])


def parse(method: str, options: Sequence[str]) -> Any:
    """The configuration that `ns-train` makes of a method and options. Raises SystemExit."""
    config = method_config(method)
    kind = (tyro.conf.SuppressFixed, tyro.conf.FlagConversionOff)  # as nerfstudio 1.1.5
    return tyro.cli(type(config), default=config, args=options, config=kind)


def splits_of(method: str, data: Path, parser: Sequence[str], *splits: str) -> list[Any]:
    """nerfstudio's DataparserOutputs of a capture's splits, `train`, `test`, by the name and the
    options of a data parser; without them by the method's own. Raises CaptureError where it cannot
    be read, or no photo is in a split, SystemExit as `parse`."""
    manager = parse(method, ["--data", str(data), *parser]).pipeline.datamanager
    manager.data = data
    try:
        reader = manager.settle_dataparser().setup()
        outputs = [reader.get_dataparser_outputs(split) for split in splits]
    except (DeSplatError, ValueError, IndexError, OSError) as error:
        raise CaptureError(
            f"'{data}' has no {' or '.join(splits)} split that can be read: {error}"
        ) from error
    if empty := [s for s, of in zip(splits, outputs, strict=True) if len(of.cameras) == 0]:
        raise CaptureError(
            f"'{data}' has no photo of the {empty[0]} split. Name a data parser that holds photos "
            "out, for instance: colmap --eval-mode interval --eval-interval 8."
        )
    return outputs


def content_of(train: Any, test: Any) -> str:
    """What is in two splits, in words; sizes are pixels of the median training photo."""
    cameras, points = train.cameras, train.metadata.get("points3D_xyz", ())
    width, height = int(cameras.width.median()), int(cameras.height.median())
    photos = f"{len(cameras)} photos train, {len(test.cameras)} test"
    return f"{photos}, {width} x {height}, {len(points)} points"
