"""Survey captures whose right decisions are known, and print how often the decisions are right.

    python -m lab.study.survey            (15 minutes the first time: scenes are generated and kept)

Generated scenes have every combination of effects; other captures have some decisions that somebody
who looks at the photos can tell. The tables are outputs/survey/table.md.
"""

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.core.errors import DeSplatError
from desplat_ns.survey.survey import survey
from desplat_ns.tools.studies.machine import code_version, processor, short, today
from desplat_ns.tools.studies.methods import splits_of
from lab import OUTPUTS, markdown_table, parser_of
from lab.study.captures import CAPTURES, HARD, PASTED, PLACES, TWINS, made
from lab.synthetic import DaylightSpec, OccluderSpec, SceneSpec, write_scene

FOLDER = OUTPUTS / "survey"

Allowed = Mapping[str, tuple[str, ...]]
"""Right decisions by effect; those of other effects are not judged."""

EFFECTS: dict[str, tuple[str, ...]] = {
    "appearance": ("off", "camera", "affine"),
    "background": ("off", "constant", "sh", "image"),
}

PLAIN_SKY = (0.62, 0.72, 0.86)
"""Of the scenes in which the sky is one colour."""


@dataclass(frozen=True)
class Strengths:
    """How strong each effect of a generated scene is where there is one."""

    light: float
    """Of the daylights; 1 is noon, clouds and dusk."""
    sun: float
    """Degrees to either side."""
    wall: float
    """Metres; the lower, the more sky."""
    covered: tuple[float, float]
    """Share of a view behind occluders, see `OccluderSpec`."""


KINDS = {
    "setting": (100, Strengths(0.8, 80.0, 2.6, (0.08, 0.3))),
    "strong": (700, Strengths(1.0, 120.0, 2.2, (0.15, 0.45))),
    "middle": (800, Strengths(0.65, 60.0, 2.8, (0.06, 0.2))),
    "faint": (900, Strengths(0.25, 15.0, 3.2, (0.01, 0.1))),
}
"""First seeds of the generated scenes, and strengths. Thresholds were set on the first kind. Nobody
who leafs through the photos of the last notices the effects at once."""


def spec_of(
    appearance: str, background: str, distractors: bool, strengths: Strengths, seed: int
) -> SceneSpec:
    """A generated scene of 20 views of 160 x 120."""
    low, high = strengths.covered
    spec = SceneSpec(
        num_views=20,
        num_extras=3,
        width=160,
        height=120,
        wall_height=6.0 if background == "off" else strengths.wall,
        occluders=OccluderSpec(min_fraction=low, max_fraction=high),
        seed=seed,
    )
    if appearance == "off" and background in ("off", "sh"):
        return spec
    daylight = DaylightSpec(
        strength=0.0 if appearance == "off" else strengths.light,
        sky=background == "image",
        sun=strengths.sun if appearance == "affine" else 0.0,
        plain_sky=PLAIN_SKY if background == "constant" else None,
    )
    return replace(spec, daylight=daylight)


@dataclass(frozen=True)
class Surveyed:
    """What a survey said of a capture."""

    kind: str
    name: str
    right: Allowed
    decisions: Mapping[str, str]
    seconds: float
    """CPU time."""

    @property
    def wrong(self) -> list[str]:
        """Effects that are decided wrongly."""
        return [
            effect for effect, known in self.right.items() if self.decisions[effect] not in known
        ]


def surveyed(kind: str, name: str, right: Allowed, capture: DataparserOutputs) -> Surveyed:
    began = time.process_time()
    decisions = survey(capture).decisions()
    return Surveyed(kind, name, right, decisions, time.process_time() - began)


def generated(folder: Path) -> Iterator[Surveyed]:
    """All combinations of effects of all kinds."""
    for kind, (first, strengths) in KINDS.items():
        truths = product(EFFECTS["appearance"], EFFECTS["background"], (False, True))
        for seed, (appearance, background, distractors) in enumerate(truths, start=first):
            spec = spec_of(appearance, background, distractors, strengths, seed)
            name = f"{kind}-{seed}"
            place = made(folder / name, partial(write_scene, spec))
            words = (*PASTED, *(() if distractors else TWINS))
            right = _right([appearance], [background])
            photos = splits_of("desplat", place, words, "train")[0]
            yield surveyed(kind, name, right, photos)


def _right(appearance: Sequence[str], background: Sequence[str] = ()) -> Allowed:
    known = {"appearance": tuple(appearance), "background": tuple(background)}
    return {effect: decisions for effect, decisions in known.items() if decisions}


KNOWN: dict[str, Allowed] = {
    "fox": _right(["camera"], ["off"]),
    "fox_cluttered": _right(["camera"], ["off"]),
    "fox_relit": _right(["camera"], ["off"]),
    "monstree": _right(["off", "camera"], ["off"]),
    "monstree_cluttered": _right(["off", "camera"], ["off"]),
    "sceaux_cluttered": _right(["camera"], ["sh"]),
    "sacre_coeur": _right(["camera", "affine"], ["image"]),
    **dict.fromkeys(PLACES, _right(["off"])),
    **dict.fromkeys(("few12", "few20", *HARD), _right(["off", "camera"])),
}
"""Right decisions of the study's captures. `fox_relit` has a gain, a tint and a gamma in each
photo, `monstree` drifts a little, and `sceaux_cluttered` has one photo in evening light. What is
true of the background of generated and altered captures is not clear: a strip of sky above walls,
or between trees."""


def known(folder: Path) -> Iterator[Surveyed]:
    """Captures of the study, those that are there or can be made."""
    for name, right in KNOWN.items():
        capture = CAPTURES[name]
        try:
            photos = splits_of("desplat", capture.locate(folder), capture.words(), "train")[0]
        except DeSplatError as error:
            print(f"{name} is left out: {error}", flush=True)
        else:
            yield surveyed("known", name, right, photos)


def page(results: Sequence[Surveyed]) -> str:
    """The dated tables: decisions by truth of generated scenes, a row for each other capture."""
    parts = [f"{today()}, commit {short(code_version())}, on {processor()}."]
    for kind in dict.fromkeys(result.kind for result in results):
        mine = [result for result in results if result.kind == kind]
        judged = sum(len(result.right) for result in mine)
        right = judged - sum(len(result.wrong) for result in mine)
        parts.append(f"## {kind}: {right} of {judged} decisions right")
        parts += [confusion(mine, effect) for effect in EFFECTS] if kind in KINDS else [rows(mine)]
    return "\n\n".join([*parts, ""])


def confusion(results: Sequence[Surveyed], effect: str) -> str:
    """Rows are truths, columns decisions, cells numbers of scenes."""
    counts = Counter((result.right[effect][0], result.decisions[effect]) for result in results)
    values = EFFECTS[effect]
    body = ([truth, *(str(counts[truth, said]) for said in values)] for truth in values)
    return markdown_table([f"{effect}, truth", *(f"says {value}" for value in values)], body)


def rows(results: Sequence[Surveyed]) -> str:
    body = (
        [r.name, *(str(r.decisions[e]) for e in EFFECTS), f"{r.seconds:.1f}", ", ".join(r.wrong)]
        for r in results
    )
    return markdown_table(["capture", *EFFECTS, "CPU, s", "wrong"], body, "lllrl")


def main() -> None:
    parser_of("python -m lab.study.survey", __doc__).parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    text = page([*generated(FOLDER), *known(FOLDER)])
    (FOLDER / "table.md").write_text(text, "utf8")
    print(text)


if __name__ == "__main__":
    main()
