"""Which runs there are."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from lab.grid.captures import AlteredCapture, GeneratedCapture, RealCapture
from lab.grid.runs import Run, Scene, Setting, Study
from lab.separation.few_views import keep_views
from lab.separation.hard_cases import make_case
from lab.separation.single_lights import light_some
from lab.synthetic import SceneSpec

BASELINES = "lab.reproduce.baselines"
DISTRACTORS = "--pipeline.model.distractors"
RATES = ("--full-rate-visits", "0")
"""Splatfacto's learning rates whatever the length of a run: what is studied is not the rates, which
short runs have raised since then (docs/results/accuracy-and-time.md)."""

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
    "no-warmup": Setting(
        "desplat", (*GIVEN, f"{DISTRACTORS}.static-warmup", "0"), "without warm-up"
    ),
    "shared-loss": Setting(
        "desplat", (*GIVEN, f"{DISTRACTORS}.static-alone", "False"), "one loss for both sets"
    ),
    "everywhere": Setting(
        "desplat", (*GIVEN, f"{DISTRACTORS}.start", "everywhere"), "distractors start everywhere"
    ),
    "lambda-paper": Setting(
        "desplat", (*GIVEN, f"{DISTRACTORS}.lambda-d", "0.01"), "lambda_d 0.01"
    ),
}
"""By name. The last four are `desplat` with one thing taken away."""


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

LIT = {"lit18": "grove18", "lit40": "other40"}
"""The same photos, some with a light of their own. Thresholds were chosen on `lit18`; `lit40` is
kept out."""

HARD = ("white", "black", "large", "small", "recurring")
"""One kind of difficult occluder each."""


CLEAN = "-clean"
"""Ends the names of scenes without what is in the way: the same photos, taken before it came."""

CLUTTERED = ("robustnerf-data",)
TWINS = (*CLUTTERED, "--train-split-clean-clutter-ratio", "0")

HALVED = ("clutter", "around", "castle", *FEW, *HARD)
"""Scenes whose photos are used at half their size."""

YARDS = (8, 16, 24, 40, 60)
"""Views of the small generated scenes, which differ in nothing else."""


FOX, AROUND = RealCapture("fox_cluttered"), RealCapture("monstree_cluttered")
CASTLE = RealCapture("sceaux_cluttered")
YARD = GeneratedCapture("yard", SceneSpec())


def _yard(views: int) -> GeneratedCapture:
    spec = SceneSpec(num_views=views, num_extras=8, width=192, height=128, seed=7)
    return GeneratedCapture(f"yard{views}", spec)


def _place(name: str) -> GeneratedCapture:
    spec = PLACES[name]
    return GeneratedCapture(f"{spec.place}{spec.num_views}-{spec.seed}", spec)


def _few(views: int) -> AlteredCapture:
    return AlteredCapture(f"fox{views}", FOX, partial(keep_views, views))


def _lit(name: str) -> AlteredCapture:
    return AlteredCapture(name, _place(LIT[name]), light_some)


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
    "yard": Scene(YARD, CLUTTERED),
    "yard-clean": Scene(YARD, TWINS),
    **{f"yard{n}": Scene(_yard(n), CLUTTERED) for n in YARDS},
    **{f"yard{n}-clean": Scene(_yard(n), TWINS) for n in YARDS},
    **{name: Scene(_case(name), CLUTTERED) for name in HARD},
    **{name: Scene(_place(name), CLUTTERED) for name in PLACES},
    **{f"{name}-clean": Scene(_place(name), TWINS) for name in PLACES},
    **{name: Scene(_lit(name), CLUTTERED) for name in LIT},
    **{f"{name}-clean": Scene(_lit(name), TWINS) for name in LIT},
    **{name: Scene(_few(views), CLUTTERED) for name, views in FEW.items()},
    **{f"{name}-clean": Scene(_few(views), TWINS) for name, views in FEW.items()},
}
"""By name. In `still` and `still-tree` nothing moves; `yard` is the demo's generated scene."""

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


OTHERS = ("around", *(f"yard{n}" for n in YARDS))
ABLATIONS = "no-warmup shared-loss everywhere lambda-paper"


def _of_others(steps: int, seeds: int) -> Iterator[Run]:
    for scene in OTHERS:
        downscale = downscale_of(scene)
        yield from _runs("off desplat", scene, downscale, steps, seeds)
        yield from _runs("off", scene + CLEAN, downscale, steps, seeds)
    yield from _runs("truth", "around", 2, steps, seeds)


def _of_unfamiliar(seeds: int) -> Iterator[Run]:
    """Captures of the kinds that users bring, 3,000 steps: few views, bare walls, gloss, fine
    detail outdoors."""
    for scene in (*PLACES, *LIT, *FEW, "castle"):
        downscale = downscale_of(scene)
        yield from _runs("off desplat", scene, downscale, 3000, seeds)
        yield from _runs("off", scene + CLEAN, downscale, 3000, seeds)
        yield from _runs("truth", scene, downscale, 3000, seeds)


_WANTED = (
    *_of_unfamiliar(3),
    *_runs("off desplat paper trimmed truth", "clutter", 2, 1000, 3),
    *_runs("off", "clean", 2, 1000, 3),
    *_runs("off asked desplat", "still still-tree", 2, 1000, 3),
    *_runs("off desplat paper trimmed truth", "clutter", 2, 3000, 3),
    *_runs("off", "clean", 2, 3000, 3),
    *_runs("off asked desplat", "still still-tree", 2, 3000, 3),
    *_of_others(1000, 3),
    *_of_others(3000, 3),
    *_of_others(7000, 1),
    *_runs("off desplat", "clutter", 2, 7000, 1),
    *_runs("off", "clean", 2, 7000, 1),
    *_runs("off desplat", "yard", 1, 1000, 3),
    *_runs("off", "yard-clean", 1, 1000, 3),
    *_runs(ABLATIONS, "clutter", 2, 1000, 1),
    *_runs("off desplat", " ".join(HARD), 2, 1000, 1),
    *_runs("off desplat", "small", 2, 1000, 3),
    *_runs(ABLATIONS, "clutter", 2, 3000, 1),
    *_runs("off desplat", " ".join(HARD), 2, 3000, 3),
    *_runs("off desplat", "yard", 1, 3000, 1),
    *_runs("off", "yard-clean", 1, 3000, 1),
    *_runs("off desplat", "clutter", 1, 3000, 1),
    *_runs("off", "clean", 1, 3000, 1),
    *_runs("off desplat", "clutter", 1, 7000, 1),
    *_runs("off", "clean", 1, 7000, 1),
    *_runs("off desplat paper truth", "clutter", 2, 30000, 1),
    *_runs("off", "clean", 2, 30000, 1),
    *_runs("off desplat", "still", 2, 30000, 1),
)
PLAN = tuple(dict.fromkeys(_WANTED))
"""Everything in the documents, the quick and the important first."""

FIGURES = (
    "psnr",
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
where these have none."""

STUDY = Study(SETTINGS, SCENES, PLAN, FIGURES)
