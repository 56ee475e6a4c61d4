"""How each data set is trained on and scored: scenes, resolutions, splits, lengths."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.evaluation.config import LpipsNet, ProtocolName

STEPS, PHOTO_TOURISM_STEPS = 30_000, 200_000
"""Of every method on a data set; B.3 gives them for DeSplat."""

RATIOS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of cluttered photos. Ours: the supplement says that they are varied, not to what."""

LPIPS_NET: LpipsNet = "alex"
"""The supplement names none. nerfstudio 1.1.4, on which the paper is built (B.3), calls LPIPS
without naming one, which gives AlexNet."""


@dataclass(frozen=True)
class Smoke:
    """How a run is cut short that tries everything and measures nothing."""

    steps: int = 100
    side: int = 160
    """Pixels of the longer side that photos have at most."""


@dataclass(frozen=True)
class Scene:
    """A scene of a data set."""

    name: str
    """As the paper calls it."""
    folder: str
    """In the published data set."""
    downscale: int | None
    """Photos at 1/N of their size; None: what the data parser takes by itself."""
    fetch: str
    """What `desplat-fetch-data` calls the download that holds it."""
    options: tuple[str, ...] = ()
    """Of the data parser, for this scene."""
    key: str = ""
    """Of its runs, where scenes share a folder."""

    @property
    def label(self) -> str:
        """In the names of runs."""
        return self.key or self.folder


@dataclass(frozen=True)
class Protocol:
    """A data set as the paper uses it."""

    name: str
    title: str
    folder: str
    """That `desplat-fetch-data` makes for the data set."""
    parser: tuple[str, ...]
    """Name and options of the data parser, as `ns-train` takes them, but for the resolution."""
    said: str
    """What the supplement says of it, and where."""
    scenes: tuple[Scene, ...]
    scoring: ProtocolName = "full"
    """Which pixels, and in which light; `half` becomes `right` for models without light."""
    steps: int = STEPS
    methods: tuple[str, ...] = ("desplat", "desplat-paper", "splatfacto")
    """That a table compares, if no others are asked for."""


def _scenes(fetch: str, downscale: int, names: str) -> tuple[Scene, ...]:
    """Scenes from words `Name:folder`."""
    pairs = (word.split(":") for word in names.split())
    return tuple(Scene(n.replace("_", " "), folder, downscale, fetch) for n, folder in pairs)


def _at_ratio(scene: Scene, ratio: float) -> Scene:
    percent = f"{100 * ratio:.0f}"
    name, key = f"{scene.name}, {percent}% cluttered", f"{scene.folder}-{percent}"
    options = ("--train-split-clean-clutter-ratio", str(ratio))
    return Scene(name, scene.folder, scene.downscale, scene.fetch, options, key)


ROBUSTNERF = Protocol(
    *("robustnerf", "RobustNeRF", "robustnerf", ("robustnerf-data",)),
    "Five scenes, photos 8 times smaller (B.1); 30,000 steps (B.3). Trained on the cluttered "
    "photos, scored on the `extra` ones.",
    _scenes(
        *("robustnerf", 8),
        "Statue:statue Android:android Crab_(1):crab1 Crab_(2):crab2 Yoda:yoda",
    ),
)

ROBUSTNERF_RATIOS = Protocol(
    *("robustnerf-ratios", "RobustNeRF, by the share of cluttered training photos"),
    *(ROBUSTNERF.folder, ROBUSTNERF.parser),
    "Crab (2) and Yoda have clean and cluttered photos of the same viewpoints, whose ratio is "
    "varied (B.1, Fig. 9 left); 30,000 steps (B.3).",
    tuple(_at_ratio(scene, ratio) for scene in ROBUSTNERF.scenes[3:] for ratio in RATIOS),
)

ON_THE_GO = Protocol(
    *("on-the-go", "NeRF On-the-go", "on-the-go", ("on-the-go-data",)),
    "Six scenes, photos 8 times smaller, those of Patio 4 times (B.1); 30,000 steps (B.3). "
    "Trained on `clutter` of split.json, scored on `extra`.",
    (
        *_scenes("on-the-go", 8, "Mountain:mountain Fountain:fountain Corner:corner"),
        *_scenes("on-the-go", 4, "Patio:patio"),
        *_scenes("on-the-go", 8, "Spot:spot Patio-High:patio_high"),
    ),
)

PHOTO_TOURISM = Protocol(
    *("photo-tourism", "Photo Tourism", "phototourism", ("photo-tourism-data",)),
    "NeRF-W's split. An embedding is found on the left half of a test photo, in 128 steps of Adam "
    "at 0.01, and the right half is scored (B.1, B.3). 200,000 steps (B.3).",
    (
        Scene("Brandenburg Gate", "brandenburg_gate", None, "brandenburg-gate"),
        Scene("Sacre Coeur", "sacre_coeur", None, "sacre-coeur"),
        Scene("Trevi Fountain", "trevi_fountain", None, "trevi-fountain"),
    ),
    scoring="half",
    steps=PHOTO_TOURISM_STEPS,
    methods=(
        *("desplat-phototourism", "desplat-phototourism-paper", "desplat-phototourism-a-paper"),
        *("splatfacto", "splatfacto-w", "splatfacto-w-a"),
    ),
)

MIPNERF360 = Protocol(
    *("mipnerf360", "Mip-NeRF 360", "mipnerf360"),
    ("colmap", "--eval-mode", "interval", "--eval-interval", "8"),
    "Seven scenes without distractors, photos of rooms 2 times smaller and those of outdoors 4 "
    "times (B.1); 30,000 steps (B.3). Every eighth photo tests, as is usual on this data set; "
    "counted as nerfstudio counts, by COLMAP's numbers.",
    (
        *_scenes("mipnerf360", 4, "bicycle:bicycle garden:garden stump:stump"),
        *_scenes("mipnerf360", 2, "room:room counter:counter kitchen:kitchen bonsai:bonsai"),
    ),
)
