from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.separation.small_rules import Judged, iou, lost_by

CELLS = np.zeros((12, 12), bool)
CELLS[4:8, 4:8] = True
BOX = np.pad(np.ones((8, 8), bool), 2)
EVERYWHERE, NOWHERE = np.ones_like(CELLS), np.zeros_like(CELLS)

FOUND = Judged(
    excess=np.where(CELLS, 1.2, 0.0),
    evidence=np.where(CELLS, 1.1, 0.0),
    is_known=EVERYWHERE,
    has_excess=CELLS,
    is_weak=CELLS,
    has_votes=EVERYWHERE,
    is_foreign=EVERYWHERE,
    connected=CELLS,
    regions=CELLS,
)
UNSEEN = replace(FOUND, regions=NOWHERE)
EXPLAINED = replace(UNSEEN, evidence=np.zeros(CELLS.shape), is_weak=NOWHERE)


@pytest.mark.parametrize(
    ("rule", "said", "ghost"),
    [
        ("found", FOUND, 0.0),
        ("few views", replace(UNSEEN, has_votes=NOWHERE), 0.0),
        ("learned", replace(UNSEEN, excess=np.zeros(CELLS.shape)), 0.9),
        ("strong excess", replace(EXPLAINED, excess=np.full(CELLS.shape, 0.9)), 0.0),
        ("weak excess", replace(EXPLAINED, has_excess=NOWHERE), 0.0),
        ("nobody knows", replace(EXPLAINED, is_known=NOWHERE, is_weak=CELLS), 0.0),
        ("witness", EXPLAINED, 0.0),
        ("witness", replace(UNSEEN, is_weak=NOWHERE), 0.0),
        ("shared detail", replace(UNSEEN, is_foreign=~CELLS), 0.0),
        ("outline", UNSEEN, 0.0),
        ("too large", replace(FOUND, connected=EVERYWHERE, regions=EVERYWHERE), 0.0),
    ],
)
def test_the_first_rule_that_loses_a_thing_is_named(rule, said, ghost):
    assert lost_by(said, CELLS, BOX, ghost) == rule


def test_masks_that_are_both_empty_have_nothing_in_common():
    assert iou(NOWHERE, NOWHERE) == 0.0
    assert iou(CELLS, BOX) == 0.25
