"""RobustNeRF-style captures: clean, cluttered and held-out photos told apart by their names.

The file name says what a photo shows: `clean` (the scene alone), `clutter` (with distractors) or
`extra` (held out, for evaluation). `clean_0001` and `clutter_0001` are twins: two photos of one
viewpoint. Folders do not count. A training photo whose name says nothing is taken for cluttered.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from nerfstudio.plugins.registry_dataparser import DataParserSpecification

from desplat_ns.core.options import ranged
from desplat_ns.data.colmap import DeSplatColmapDataParser, OwnSplitConfig
from desplat_ns.data.splits import Lists, shuffled


@dataclass
class RobustNerfDataParserConfig(OwnSplitConfig):
    """COLMAP capture whose file names say `clean`, `clutter` or `extra` (held out)."""

    _target: type = field(default_factory=lambda: RobustNerfDataParser)
    train_split_clean_clutter_ratio: float = ranged(1.0, "[0, 1]")
    """0 trains on clean photos only, 1 on cluttered ones only; between, each viewpoint is taken
    once, this fraction of them cluttered. Photos with `extra` in the file name are held out."""


class RobustNerfDataParser(DeSplatColmapDataParser):
    config: RobustNerfDataParserConfig
    split_by = "file names: `clutter` or `clean` trains (by the ratio), `extra` is held out"

    def lists(self, names: Sequence[str]) -> Lists:
        train = names_by_ratio(names, self.config.train_split_clean_clutter_ratio)
        return {"train": train, "test": [name for name in names if kind_of(name) == "extra"]}


def kind_of(name: str) -> str:
    """What a photo shows, from its file name, in any case: clean, clutter or extra."""
    stem = Path(name).stem.lower()
    if "extra" in stem:
        return "extra"
    return "clean" if "clean" in stem and "clutter" not in stem else "clutter"


def viewpoint_of(name: str) -> str:
    """What twins share: what follows the word in the file name, else what precedes it."""
    before, *after = re.split("clean|clutter|extra", Path(name).stem.lower(), maxsplit=1)
    return after[0].strip("_-. ") or before.strip("_-. ") if after else before


def names_by_ratio(names: Sequence[str], ratio: float) -> list[str]:
    """Training photos, each viewpoint once: the fraction `ratio` cluttered, the rest clean.

    Of the viewpoints that have both twins, round(ratio * n) are taken cluttered and the others
    clean. Of those that have one photo only, round(ratio * n) of the cluttered and
    round((1 - ratio) * n) of the clean ones are taken. A larger ratio keeps the cluttered
    viewpoints of a smaller one.
    """
    groups: dict[str, dict[str, list[str]]] = {"clean": {}, "clutter": {}, "extra": {}}
    for name in names:
        groups[kind_of(name)].setdefault(viewpoint_of(name), []).append(name)
    clean, clutter = groups["clean"], groups["clutter"]
    twins = shuffled(clean.keys() & clutter.keys())
    num_cluttered = round(ratio * len(twins))
    picked = [clutter[key] for key in twins[:num_cluttered]]
    picked += [clean[key] for key in twins[num_cluttered:]]
    for one_sort, share in ((clutter, ratio), (clean, 1.0 - ratio)):
        singles = shuffled(one_sort.keys() - set(twins))
        picked += [one_sort[key] for key in singles[: round(share * len(singles))]]
    return [name for group in picked for name in group]


def describe(names: Sequence[str]) -> str:
    """`40 clean, 40 clutter, 10 extra`: what the file names say."""
    kinds = [kind_of(name) for name in names]
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("clean", "clutter", "extra"))


robustnerf_dataparser = DataParserSpecification(RobustNerfDataParserConfig())
