"""Which runs there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from lab.documents import RECORDS
from lab.grid.captures import AlteredCapture, GeneratedCapture, RealCapture
from lab.grid.runs import Run, Scene, Setting, Study
from lab.separation.few_views import keep_views
from lab.separation.hard_cases import make_case
from lab.synthetic import SceneSpec

FILE = RECORDS / "separation.json"

BASELINES = "lab.reproduce.baselines"
RATES = ("--full-rate-visits", "0")
"""Splatfacto's learning rates whatever the length of a run: what is studied is not the rates, which
short runs have raised since then (docs/results/speed.md)."""

GIVEN = (*RATES, "--pipeline.model.effects.auto", "False")
"""Distractors alone, whatever a survey would say: what is studied is not what it decides."""

PLAIN = ("--pipeline.model.opacity-prior", "0")
"""Without what `desplat` charges for opacity: baselines are Splatfacto's own."""

OFF = (*GIVEN, *PLAIN, "--pipeline.model.effects.distractors", "False")

SETTINGS = {
    "off": Setting("desplat", OFF, "distractors off"),
    "trimmed": Setting(f"{BASELINES}:by_residual", RATES, "off, trimmed loss"),
    "paper": Setting("desplat-paper", (), "`desplat-paper`"),
    "desplat": Setting("desplat", GIVEN, "**`desplat`**"),
    "asked": Setting("desplat", RATES, "`desplat`, effects as its survey says"),
    "truth": Setting(f"{BASELINES}:by_truth", RATES, "off, true masks as weights"),
}
"""By name."""


PLACES = {
    "room15": SceneSpec.bare_room(15, seed=7),
    "room40": SceneSpec.bare_room(40, seed=7),
    "grove18": SceneSpec.fine_grove(18, seed=7),
    "other15": SceneSpec.bare_room(15, seed=8),
    "other40": SceneSpec.bare_room(40, seed=8),
    "other18": SceneSpec.fine_grove(18, seed=8),
    "facade8": SceneSpec.facade(8, seed=7),
    "facade16": SceneSpec.facade(16, seed=7),
    "table20": SceneSpec.table_top(20, seed=7),
    "other-facade8": SceneSpec.facade(8, seed=8),
    "other-facade16": SceneSpec.facade(16, seed=8),
    "other-table20": SceneSpec.table_top(20, seed=8),
}
"""Generated rooms of bare walls and gloss, groves as fine as a pixel, houses behind a lawn and
tables before a far room. Thresholds were chosen on those of seed 7; the others are kept out."""

FEW = {"few12": 12, "few20": 20}
"""So many of `fox_cluttered`'s views. Thresholds were chosen on `few12`; `few20` is kept out."""

HARD = ("white", "black", "large", "small", "recurring")
"""One kind of difficult occluder each."""


CLEAN = "-clean"
"""Ends the names of scenes without what is in the way: the same photos, taken before it came."""

CLUTTERED = ("robustnerf-data",)
TWINS = (*CLUTTERED, "--train-split-clean-clutter-ratio", "0")

HALVED = ("clutter", "around", "castle", *FEW, *HARD)
"""Scenes whose photos are used at half their size."""

YARDS = (8, 16, 24)
"""Views of the small generated scenes of `lab.front`, which differ in nothing else."""


FOX, AROUND = RealCapture("fox_cluttered"), RealCapture("monstree_cluttered")
CASTLE = RealCapture("sceaux_cluttered")


def _yard(views: int) -> GeneratedCapture:
    spec = SceneSpec(num_views=views, num_extras=8, width=192, height=128, seed=7)
    return GeneratedCapture(f"yard{views}", spec)


def _place(name: str) -> GeneratedCapture:
    spec = PLACES[name]
    return GeneratedCapture(f"{spec.place}{spec.num_views}-{spec.seed}", spec)


def _few(views: int) -> AlteredCapture:
    return AlteredCapture(f"fox{views}", FOX, partial(keep_views, views))


def _case(name: str) -> AlteredCapture:
    return AlteredCapture(name, FOX, partial(make_case, name))


SCENES = {
    "clutter": Scene(FOX, CLUTTERED),
    "clean": Scene(FOX, TWINS),
    "around": Scene(AROUND, CLUTTERED),
    "around-clean": Scene(AROUND, TWINS),
    "castle": Scene(CASTLE, CLUTTERED),
    "castle-clean": Scene(CASTLE, TWINS),
    "still": Scene(RealCapture("fox"), ("colmap",)),
    "still-tree": Scene(RealCapture("monstree"), ("colmap",)),
    **{f"yard{n}": Scene(_yard(n), CLUTTERED) for n in YARDS},
    **{name: Scene(_case(name), CLUTTERED) for name in HARD},
    **{name: Scene(_place(name), CLUTTERED) for name in PLACES},
    **{f"{name}-clean": Scene(_place(name), TWINS) for name in PLACES},
    **{name: Scene(_few(views), CLUTTERED) for name, views in FEW.items()},
    **{f"{name}-clean": Scene(_few(views), TWINS) for name, views in FEW.items()},
}
"""By name. In `still` and `still-tree` nothing moves."""

SEEDS = (42, 43, 44)


def downscale_of(scene: str) -> int:
    """By how much a scene's photos are reduced when they are read."""
    return 2 if scene.removesuffix(CLEAN) in HALVED else 1


def twins_of(scene: str) -> str:
    """The scene of the same photos without what is in the way."""
    return "clean" if scene in ("clutter", *HARD) else scene + CLEAN


def _runs(settings: str, scenes: str, downscale: int, steps: int, seeds: int) -> Iterator[Run]:
    for seed in SEEDS[:seeds]:
        for scene in scenes.split():
            for setting in settings.split():
                yield Run(setting, scene, downscale, steps, seed)


CHOSEN = ("clutter", "few12", "room15", "grove18", "facade8", "table20")
KEPT_OUT = ("around", "castle", "few20", "other15", "other40", "other18")
KEPT_OUT += ("other-facade8", "other-facade16", "other-table20")
"""Captures on which a threshold was chosen or looked at, and those kept out of that."""


def _of_captures(settings: str, scenes: Sequence[str]) -> Iterator[Run]:
    """3,000 steps, with three seeds each; baselines on the clean twins as well."""
    for scene in scenes:
        yield from _runs(settings, scene, downscale_of(scene), 3000, 3)
        if "off" in settings.split():
            yield from _runs("off", twins_of(scene), downscale_of(scene), 3000, 3)


_WANTED = (
    *_of_captures("off desplat truth", KEPT_OUT),
    *_of_captures("off desplat paper trimmed truth", ["clutter"]),
    *_of_captures("desplat", CHOSEN),
    *_of_captures("off desplat", HARD),
    *_runs("off asked", "still still-tree", 2, 3000, 3),
)
PLAN = tuple(dict.fromkeys(_WANTED))
"""Everything in the documents, the important first."""

FIGURES = (
    "psnr",
    "psnr_worst",
    "ssim",
    "mask_iou",
    "alpha_outside_masks",
    "mask_iou_with_shadows",
    "alpha_outside_masks_with_shadows",
    "num_static_gaussians",
    "num_distractor_gaussians",
    "train_cpu_seconds",
)
"""The mask scores are absent where there are no distractors or no masks, those with shadows also
where these have none, and the worst view in records of 4d24db6 and before."""

STUDY = Study(SETTINGS, SCENES, PLAN, FIGURES)
