"""Files under poison: what is read is finite, or an error names the file."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pycolmap
import torch
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
from nerfstudio.utils.rich_utils import CONSOLE
from torch import Tensor

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.robustnerf_names import views_by_file
from desplat_ns.data.transforms_json import PromptFreeNerfstudio
from desplat_ns.errors import DeSplatError
from desplat_ns.photo_tourism.split_file import match_split, read_split_file
from desplat_ns.training.checkpoint_files import load_checkpoint, load_newest
from lab.synthetic import SceneSpec, write_scene
from tests.stability.poison import POISON

REFUSED, CULLED, FINE, FAULT = "refused", "culled", "fine", "fault"

WORDS = ("", "nan", "NaN", "inf", "-inf", "1e999", "1e38", "-0.0", "1e-45", "0", "-1", "x", "4e9")
"""What is put into text files."""

ODD = (*POISON, None, "x", "", [], {}, True, 2**70, -(2**70))
"""What is put into JSON files and checkpoints."""


@dataclass(frozen=True)
class Source:
    """One kind of file: how to write it, and how it is read."""

    name: str
    damage: Callable[[random.Random, Path], None]
    """Spoil one healthy file or folder."""
    read: Callable[[Path], Any]
    """Numbers that came of it; raises DeSplatError."""


def fate_of(source: Source, rng: random.Random, healthy: Path, work: Path) -> str:
    """What became of one damaged copy, made in `work`; a fault is returned as its description."""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(healthy, work, symlinks=True)
    source.damage(rng, work)
    try:
        with CONSOLE.capture() as said:
            content = source.read(work)
    except DeSplatError as error:
        named = str(work) in str(error)
        return REFUSED if named else f"{FAULT}: {source.name}: no file is named: {error}"
    except Exception as error:
        return f"{FAULT}: {source.name}: {type(error).__name__}: {error}"
    for value in tensors_of(content):
        if value.is_floating_point() and not bool(value.isfinite().all()):
            return f"{FAULT}: {source.name}: read, and not finite"
    return CULLED if "left out" in said.get() or "Going on from" in said.get() else FINE


def tensors_of(value: Any) -> list[Tensor]:
    """All numbers inside, as tensors."""
    if isinstance(value, Tensor):
        return [value]
    if isinstance(value, float):
        return [torch.tensor(value)]
    if isinstance(value, dict):
        return [t for v in value.values() for t in tensors_of(v)]
    return [t for v in value for t in tensors_of(v)] if isinstance(value, (list, tuple)) else []


# --- how files are spoiled ------------------------------------------------------------------------


def cut(rng: random.Random, path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: rng.choice([0, 1, len(data) // 2, len(data) - 1])])


def spoil_bytes(rng: random.Random, path: Path) -> None:
    """Bits, a poisoned double somewhere, or a file that was cut off."""
    data = bytearray(path.read_bytes())
    kind = rng.randrange(3)
    if kind == 0:
        return cut(rng, path)
    at = rng.randrange(max(1, len(data) - 8))
    if kind == 1:
        data[at] ^= 1 << rng.randrange(8)
    else:
        data[at : at + 8] = np.float64(rng.choice(POISON)).tobytes()
    path.write_bytes(data)


def spoil_words(rng: random.Random, path: Path) -> None:
    """One to three words of a text file replaced; or lines lost, or the file cut off."""
    if rng.random() < 0.15:
        return cut(rng, path)
    lines = path.read_text().split("\n")
    for _ in range(rng.randint(1, 3)):
        i = rng.randrange(len(lines))
        separator = "\t" if "\t" in lines[i] else " "
        words = lines[i].split(separator)
        words[rng.randrange(len(words))] = rng.choice(WORDS)
        lines[i] = separator.join(words)
    if rng.random() < 0.1:
        del lines[rng.randrange(len(lines))]
    path.write_text("\n".join(lines))


def spoil_json(rng: random.Random, path: Path) -> None:
    """One to three values replaced or keys removed; or the file cut off."""
    if rng.random() < 0.1:
        return cut(rng, path)
    root = json.loads(path.read_text())
    for _ in range(rng.randint(1, 3)):
        here: Any = root
        while True:
            key = rng.choice(list(here) if isinstance(here, dict) else range(len(here)))
            if not isinstance(here[key], (dict, list)) or not here[key] or rng.random() < 0.05:
                break
            here = here[key]
        if isinstance(here, dict) and rng.random() < 0.2:
            del here[key]
        else:
            here[key] = rng.choice(ODD)
        if not root:
            break
    path.write_text(json.dumps(root))


def spoil_one_of(spoil: Callable[[random.Random, Path], None], pattern: str) -> Callable:
    def damage(rng: random.Random, folder: Path) -> None:
        spoil(rng, rng.choice(sorted(folder.glob(pattern))))

    return damage


def spoil_checkpoint(rng: random.Random, folder: Path) -> None:
    """The newest checkpoint: damaged bytes, or entries of a wrong kind."""
    path = folder / "step-000000009.ckpt"
    if rng.random() < 0.5:
        return spoil_bytes(rng, path)
    state = torch.load(path, weights_only=True)
    key = rng.choice(sorted(state))
    if rng.random() < 0.3:
        del state[key]
    else:
        state[key] = rng.choice(ODD)
    torch.save(state, path)


# --- what reads them ------------------------------------------------------------------------------


def numbers_of(outputs: Any) -> list[Any]:
    cameras, metadata = outputs.cameras, outputs.metadata
    distortion = [] if cameras.distortion_params is None else [cameras.distortion_params]
    points = [v for k, v in metadata.items() if k.startswith("points3D") and v is not None]
    places = [cameras.camera_to_worlds, cameras.fx, cameras.fy, cameras.cx, cameras.cy]
    assert bool((cameras.width > 0).all()) and bool((cameras.height > 0).all())
    return [places, distortion, points, outputs.dataparser_transform, outputs.dataparser_scale]


def read_transforms(folder: Path) -> Any:
    config = NerfstudioDataParserConfig(_target=PromptFreeNerfstudio, data=folder)
    config.load_3D_points = True
    return numbers_of(config.setup().get_dataparser_outputs("train"))


def read_robustnerf(folder: Path) -> Any:
    return numbers_of(RobustNerfDataParserConfig(data=folder).setup().get_dataparser_outputs())


NAMES = [f"photo_{i:04d}.png" for i in range(1, 7)]


def read_split(folder: Path) -> Any:
    split = match_split(NAMES, read_split_file(folder / "yard.tsv"))
    assert split.train and split.test and not {*split.train} & {*split.test}
    return []


def read_listing(folder: Path) -> Any:
    picked = views_by_file(NAMES, folder / "train.txt")
    assert all(0 <= i < len(NAMES) for i in picked)
    return []


def read_newest(folder: Path) -> Any:
    path, state = load_newest(folder)
    assert isinstance(state["step"], int) and state["step"] >= 0
    for part in ("pipeline", "optimizers"):
        assert isinstance(state[part], dict)
    load_checkpoint(path)
    return []


SOURCES = (
    Source("transforms.json", spoil_one_of(spoil_json, "transforms.json"), read_transforms),
    Source("COLMAP, text", spoil_one_of(spoil_words, "sparse/0/*.txt"), read_robustnerf),
    Source("COLMAP, binary", spoil_one_of(spoil_bytes, "sparse/0/*.bin"), read_robustnerf),
    Source("split file (.tsv)", spoil_one_of(spoil_words, "yard.tsv"), read_split),
    Source("list of photos", spoil_one_of(spoil_words, "train.txt"), read_listing),
    Source("checkpoint", spoil_checkpoint, read_newest),
)


# --- healthy ones ---------------------------------------------------------------------------------


def write_healthy(folder: Path) -> dict[str, Path]:
    """One healthy folder for each of `SOURCES`, by its name."""
    places = {source.name: folder / str(i) for i, source in enumerate(SOURCES)}
    binary, text = places["COLMAP, binary"], places["COLMAP, text"]
    write_scene(replace(SceneSpec.tiny(), num_points=40), binary)
    shutil.copytree(binary / "images", text / "images")
    (text / "sparse" / "0").mkdir(parents=True)
    pycolmap.Reconstruction(binary / "sparse" / "0").write_text(text / "sparse" / "0")
    write_transforms(places["transforms.json"])
    tsv = places["split file (.tsv)"]
    tsv.mkdir()
    rows = [f"{name}\t{i}\t{'test' if i == 6 else 'train'}\tx" for i, name in enumerate(NAMES, 1)]
    (tsv / "yard.tsv").write_text("\n".join(["filename\tid\tsplit\tdataset", *rows]) + "\n")
    listing = places["list of photos"]
    listing.mkdir()
    (listing / "train.txt").write_text("\n".join(NAMES[:4]) + "\n")
    checkpoints = places["checkpoint"]
    checkpoints.mkdir()
    for step in (4, 9):
        state = {"step": step, "pipeline": {"w": torch.rand(50)}, "optimizers": {"a": {}}}
        torch.save(state, checkpoints / f"step-{step:09d}.ckpt")
    return places


def write_photos(folder: Path) -> None:
    folder.mkdir(parents=True)
    for name in NAMES:
        PIL.Image.fromarray(np.full((6, 8, 3), 99, np.uint8)).save(folder / name)


def write_transforms(folder: Path) -> None:
    """Six photos on a line, two points."""
    write_photos(folder / "images")
    frames = []
    for i, name in enumerate(NAMES):
        pose = np.eye(4)
        pose[0, 3] = i
        frames.append({"file_path": f"images/{name}", "transform_matrix": pose.tolist()})
    intrinsics = {"fl_x": 10.0, "fl_y": 11.0, "cx": 4.0, "cy": 3.0, "w": 8, "h": 6, "k1": 0.01}
    points = "0 0 -3 9 9 9\n1 0 -4 9 9 9\n"
    kinds = [f"property float {c}" for c in "xyz"]
    kinds += [f"property uchar {c}" for c in ("red", "green", "blue")]
    header = ["ply", "format ascii 1.0", "element vertex 2", *kinds, "end_header"]
    (folder / "points.ply").write_text("\n".join(header) + "\n" + points)
    content = {**intrinsics, "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))
