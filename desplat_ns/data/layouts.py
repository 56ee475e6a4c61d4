"""Which layout a capture has: what was found, what else could be read, or what is missing; and
`desplat-data`, the dataparser that takes the one that reads it.

To add a layout, write what finds it and enter it in `LAYOUTS`, before those that are less specific.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from nerfstudio.data.dataparsers.base_dataparser import DataParser, DataParserConfig
from nerfstudio.data.dataparsers.blender_dataparser import BlenderDataParserConfig
from nerfstudio.data.dataparsers.colmap_dataparser import ColmapDataParserConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import Nerfstudio, NerfstudioDataParserConfig
from nerfstudio.data.dataparsers.phototourism_dataparser import PhototourismDataParserConfig
from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.core.console import announce, list_names
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.options import option_of
from desplat_ns.data.colmap import DeSplatColmapDataParserConfig, OwnSplitConfig, with_pycolmap
from desplat_ns.data.colmap_model import find_models
from desplat_ns.data.on_the_go import (
    SPLIT_FILE,
    TRANSFORMS_FILE,
    OnTheGoDataParserConfig,
    read_split,
)
from desplat_ns.data.photo_files import downscale_factors, photo_names, photos_near
from desplat_ns.data.photo_tourism import DENSE, PhotoTourismDataParserConfig, split_files
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig, describe
from desplat_ns.data.transforms_json import TransformsDataParser

IMAGES = DeSplatColmapDataParserConfig().images_path
"""Folder of the photos; beside it, `images_N` has copies at 1/N of their size."""


@dataclass(frozen=True)
class Recognition:
    """A layout that a capture's folder has, and how it is read."""

    data: Path
    layout: str
    parser: str
    """Name of the dataparser in ns-train."""
    default: Any
    """The dataparser's configuration with its own options."""
    poses: str
    """Where they are."""
    summary: str
    """What lies there, as part of a sentence."""
    options: Mapping[str, Any]
    """Options of the dataparser that it calls for."""
    others: "tuple[Recognition, ...]" = ()
    """Other readings that see other poses."""

    @property
    def words(self) -> tuple[str, ...]:
        """What names this reading at the end of an ns-train command."""
        options = self.options.items()
        words = [word for name, value in options for word in (option_of(name), str(value))]
        return (self.parser, *words)

    def line(self) -> str:
        """What was found, what reads it, and what to type for another reading."""
        return (
            f"Capture {self.data} has the layout of {self.layout}: {self.summary}. "
            f"It is read by {self.parser}."
        ) + "".join(
            f" Also found: {other.summary}; to read that instead, end the command "
            f"with `{' '.join(other.words)}`."
            for other in self.others
        )

    def config(self, options: Mapping[str, Any]) -> DataParserConfig:
        """The configuration of the dataparser that reads the capture; `options` of the user's, by
        their fields' names, come before the layout's. Raises ConfigError of one without a use."""
        useful = {f.name for f in fields(self.default)}
        if isinstance(self.default, OwnSplitConfig):  # the layout says which photos are held out
            useful -= {"eval_mode", "train_split_fraction", "eval_interval"}
        if useless := [name for name in options if name not in useful]:
            given = " ".join(f"{option_of(name)} {options[name]}" for name in useless)
            raise ConfigError(
                f"{given} has no use here: {self.data} has the layout of {self.layout}. Leave it "
                f"out, or name another dataparser, as in `colmap {given}`. `{self.parser} --help`"
                " at the end of the command lists the options of this one."
            )
        return replace(self.default, data=self.data, **{**self.options, **options})


def recognise(data: Path) -> Recognition:
    """The layout of the capture in a folder, or of a transforms.json. Raises CaptureError where
    there is no such folder, or nothing in it that is a capture."""
    if not data.is_dir() and not (data.suffix == ".json" and data.is_file()):
        raise CaptureError(
            f"There is no folder {data}. --data takes the folder of a capture, or its "
            "transforms.json."
        )
    if not (readings := _readings(data)):
        raise CaptureError(_nothing_found(data))
    taken, *rest = readings
    others = (reading for reading in rest if reading.poses != taken.poses)
    return replace(taken, others=tuple(others))


def is_capture(data: Path) -> bool:
    """Whether a path is a folder, or a transforms.json, in which photos have poses."""
    return (data.is_dir() or data.suffix == ".json") and bool(_readings(data))


def _readings(data: Path) -> list[Recognition]:
    return [
        Recognition(data, layout, parser, default, *found)
        for layout, parser, default, find in LAYOUTS
        if (found := find(data)) is not None
    ]


def _nothing_found(data: Path) -> str:
    entries = sorted(path.name for path in data.iterdir())
    folders = [data / name for name in entries if (data / name).is_dir()]
    if near := [str(f) for f in (*folders, data.resolve().parent) if _readings(f)]:
        return f"{data} is no capture. Name one that is, by --data: {list_names(near)}."
    photos = photos_near(data)
    if photos and "transforms_train.json" not in entries:
        return (
            f"{data} has {len(photos)} photos ({list_names(photos)}) and no poses of their "
            f"cameras. Type `desplat-process '{data}' CAPTURE` to find them, or run COLMAP by "
            "itself; then train with --data CAPTURE."
        )
    return (
        f"No capture was found in {data}, which has {list_names(entries) or 'no files'}. Needed: "
        "images/, or images_2, images_4, ..., and a COLMAP model (cameras, images and points3D as "
        ".bin or .txt) in sparse/0, sparse or colmap/sparse/0; or dense/images and dense/sparse; "
        "or transforms.json; or transforms_train.json, transforms_val.json and "
        "transforms_test.json, each with camera_angle_x, and X.png for each file_path X (where "
        "they have nerfstudio's fields, name one of them itself). Check the path after --data, or "
        "name a dataparser at the end of the command (ns-train desplat --help lists them)."
    )


# --- what finds each layout -----------------------------------------------------------------------

Found = tuple[str, str, dict[str, Any]]
"""Of a `Recognition`: poses, summary, options."""


def _on_the_go(data: Path) -> Found | None:
    """split.json with the lists of NeRF On-the-go, and poses."""
    poses = _model_of(data) or TRANSFORMS_FILE
    try:
        lists = read_split(data / SPLIT_FILE)
    except CaptureError:
        return None
    if poses == TRANSFORMS_FILE and not (data / TRANSFORMS_FILE).is_file():
        return None
    counts = ", ".join(f"{len(positions)} {name}" for name, positions in lists.items())
    return poses, f"{SPLIT_FILE} ({counts}) with {poses}", _photos(data)[1]


def _robustnerf(data: Path) -> Found | None:
    """`extra` and `clutter` or `clean` in the names of photos, over a COLMAP model."""
    model = _model_of(data)
    images, options = _photos(data)
    names = photo_names(images) if model else []
    stems = " ".join(Path(name).stem.lower() for name in names)
    if "extra" not in stems or not ("clutter" in stems or "clean" in stems):
        return None
    return model, f"photos named by what they show ({describe(names)}) and {model}", options


def _photo_tourism(data: Path) -> Found | None:
    """dense/ with photos and a COLMAP model, or a NeRF-W split file beside them."""
    split, _ = split_files(data)
    poses = _model_of(data)
    if find_models(data, DENSE / "sparse") and (data / DENSE / "images").is_dir():
        poses = f"{DENSE}/images and {DENSE}/sparse"
    elif not split and data.resolve().name != DENSE.name:
        return None
    by = f"the split file {split[0].name}" if split else "no split file: a draw holds photos out"
    return (poses, f"{poses} ({by})", {}) if poses else None


def _transforms(data: Path) -> Found | None:
    """A transforms.json, also named itself."""
    path = data if data.suffix == ".json" else data / TRANSFORMS_FILE
    return (path.name, path.name, {"load_3D_points": True}) if path.is_file() else None


def _blender(data: Path) -> Found | None:
    """transforms_train.json and those beside it, where nerfstudio's blender-data can read them."""
    names = []
    try:
        for split in ("train", "val", "test"):
            BlenderDataParserConfig(data=data).setup().get_dataparser_outputs(split)
            names.append(f"transforms_{split}.json")
    except Exception:  # it checks nothing, so that errors are of many kinds
        return None
    return ", ".join(names), ", ".join(names), {}


def _colmap(data: Path) -> Found | None:
    """A COLMAP model in a usual place; photos, or smaller copies as Mip-NeRF 360 has them."""
    model = _model_of(data)
    copies = "".join(f", {IMAGES}_{factor}" for factor in downscale_factors(data / IMAGES))
    return (model, f"{model}{copies}", _photos(data)[1]) if model else None


def _model_of(data: Path) -> str:
    """COLMAP's model in a usual place, as part of a sentence; empty if there is none."""
    models = find_models(data, Path("sparse"))
    if not models:
        return ""
    folder = models[0] if len(models) == 1 else models[0].parent  # of several, the parser takes one
    return f"COLMAP's model in {folder.relative_to(data).as_posix()}"


def _photos(data: Path) -> tuple[Path, dict[str, Any]]:
    """Folder of the photos, or of the largest copies if they are all there is; the options with
    which a dataparser reads it."""
    images = data / IMAGES
    factors = downscale_factors(images)
    if images.is_dir() or not factors:
        return images, {}
    return data / f"{IMAGES}_{factors[0]}", {"downscale_factor": factors[0]}


_TRANSFORMS = NerfstudioDataParserConfig(_target=TransformsDataParser)

LAYOUTS: tuple[tuple[str, str, DataParserConfig, Callable[[Path], Found | None]], ...] = (
    ("NeRF On-the-go", "on-the-go-data", OnTheGoDataParserConfig(), _on_the_go),
    ("RobustNeRF", "robustnerf-data", RobustNerfDataParserConfig(), _robustnerf),
    ("Photo Tourism", "photo-tourism-data", PhotoTourismDataParserConfig(), _photo_tourism),
    ("nerfstudio", "nerfstudio-data", _TRANSFORMS, _transforms),
    ("Blender (NeRF synthetic)", "blender-data", BlenderDataParserConfig(), _blender),
    ("COLMAP", "colmap", DeSplatColmapDataParserConfig(), _colmap),
)
"""Name, dataparser, its own options, and what finds the layout; the first that is found is taken,
so that the most specific ones come first."""


# --- the dataparser ------------------------------------------------------------------------------


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
    auto_scale_poses: bool | None = None
    """Whether the cameras are scaled into a box from -1 to 1."""
    load_3D_points: bool | None = None
    """Whether training starts from the reconstruction's points instead of random ones."""

    def setup(self, **kwargs: Any) -> Any:
        """The dataparser that reads the capture. Raises as `without_prompts`."""
        return without_prompts(self).setup(**kwargs)


desplat_dataparser = DataParserSpecification(DeSplatDataParserConfig())

OURS = {
    "desplat-data": DeSplatDataParserConfig(),
    "robustnerf-data": RobustNerfDataParserConfig(),
    "photo-tourism-data": PhotoTourismDataParserConfig(),
    "on-the-go-data": OnTheGoDataParserConfig(),
}
"""This package's dataparsers by name, so that a checkout can be used without being installed."""


def without_prompts(config: DataParserConfig) -> DataParserConfig:
    """The dataparser that reads a capture: for desplat-data the one for the layout that is
    recognised, and the console says which and why; for upstream's that ask questions ours; else the
    same.

    Raises:
        CaptureError: as `recognise`.
        ConfigError: as `Recognition.config`; or upstream's phototourism-data (1.1.5), one hyphen
            from ours: it gives no 3D points and splits by its own rule, so figures would be wrong
            without a word.
    """
    if isinstance(config, DeSplatDataParserConfig):
        match, fixed = recognise(config.data), ("_target", "data")
        given = {n: v for n, v in vars(config).items() if v is not None and n not in fixed}
        reader = match.config(given)
        announce(match.line())
        return reader
    if type(config) is PhototourismDataParserConfig:
        raise ConfigError(
            "nerfstudio's dataparser phototourism-data gives no 3D points to start from and does "
            "not read NeRF-W's split. Use photo-tourism-data, with two hyphens."
        )
    if type(config) is ColmapDataParserConfig:
        return with_pycolmap(config)
    if type(config) is NerfstudioDataParserConfig and config._target is Nerfstudio:
        return replace(config, _target=TransformsDataParser)
    return config
