"""Files of captures."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def touch(folder: Path, *names: str) -> Path:
    """Files that hold next to nothing, with their folders; gives `folder`."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


def posed(path: str, x: float) -> dict[str, Any]:
    """A frame of transforms.json whose camera stands at x."""
    matrix = [[1.0, 0, 0, x], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
    return {"file_path": path, "transform_matrix": matrix}


def write_transforms(data: Path, names: Sequence[str], **head: Any) -> Path:
    """transforms.json, without points: photo i below images/ stands at x = i; gives `data`.

    Args:
        head: other values of its head; photos have 8 x 6 pixels.
    """
    frames = [posed(f"images/{name}", i) for i, name in enumerate(names)]
    lens = {"fl_x": 10, "fl_y": 10, "cx": 4, "cy": 3, "w": 8, "h": 6}
    (data / "transforms.json").write_text(json.dumps({**lens, "frames": frames, **head}))
    return data


def write_split(path: Path, split: Mapping[str, str]) -> None:
    """NeRF-W's split file; ids count from 1."""
    rows = [f"{name}\t{i}.0\t{kind}\tscene" for i, (name, kind) in enumerate(split.items(), 1)]
    path.write_text("\n".join(["filename\tid\tsplit\tdataset", *rows]) + "\n")
