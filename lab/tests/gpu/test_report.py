from __future__ import annotations

import re
from typing import Any

import pytest

from desplat_ns.calibration.scenes import PARAMETERS
from lab.gpu.plan import PARTS
from lab.gpu.records import FAILED, LATE, MEASURED, NO_TIME, Record, Run
from lab.gpu.report import report
from lab.gpu.scenes import PLACED

SPREAD = {"median": 10.0, "low": 9.0, "high": 12.0, "count": 90}
SCENE = "100k @ 648 x 420"
COUNTS = {
    **dict.fromkeys(("waits", "cudaStreamSynchronize", "cudaMemcpy", "launches"), 7.0),
    **dict.fromkeys(("cudaDeviceSynchronize", "cudaEventSynchronize"), 0.0),
    **dict.fromkeys(("Memcpy DtoH", "Memcpy HtoD"), 3.0),
    **dict.fromkeys(("aten::_local_scalar_dense", "aten::nonzero"), 2.0),
}
TRAINED = {
    **{"steps": 1000, "threads": 4, "psnr": 24.5, "ssim": 0.8, "mask_iou": 0.91},
    **{"train_wall_seconds": 61.0, "num_static_gaussians": 12_345, "num_distractor_gaussians": 678},
}
FIGURES: dict[str, dict[str, Any]] = {
    "machine": {"GPU": "A GPU", "Driver": "1.2.3"},
    "kernels": {"seconds": 120.4, "jobs": 12, "architecture": "9.0"},
    "suite": {
        **{"passed": 50, "failed": 1, "error": 0, "skipped": 2},
        **{"bad": ["tests.x.test_y: it | broke"], "reasons": {"gsplat 1.5 differs": 2}},
    },
    "parity": {
        "rows": [
            {
                **{"reference": "exact lists", "scene": SCENE, "contender": "gsplat"},
                **{"largest": 1e-2, "largest_unflipped": 1e-5, "flipped": 1e-3},
                "gradients": dict.fromkeys(PARAMETERS, 1e-6) | {"quats": 3e-4},
            }
        ]
    },
    "steps": {
        "rows": [
            {"scene": SCENE, "case": "Splatfacto", "ms": SPREAD, "ratio": 1.0, "mb": 1234.5},
            {"scene": SCENE, "case": PLACED, "ms": SPREAD, "ratio": 1.12, "mb": None},
        ]
    },
    "synchronisations": {"steps": 40, "methods": {"splatfacto": COUNTS, "desplat": COUNTS}},
    "rendering": {
        "metrics": "PSNR, SSIM",
        "rows": [
            {"scene": SCENE, "case": "Splatfacto", "what": what, "fps": SPREAD}
            for what in ("drawn", "scored")
        ],
    },
    "training.cpu": {"capture": "generated", "device": "cpu", "backend": "numba", **TRAINED},
    "training.gpu": {"capture": "generated", "device": "cuda", "backend": "gsplat", **TRAINED},
    "training.real": {"capture": "fox_cluttered", "device": "cuda", "backend": "gsplat", **TRAINED},
}
"""Of a run that measured everything."""


def a_run(device: str = "cuda", **records: Record) -> Run:
    parts = {p.name: Record(MEASURED, 1.0, p.deadline, figures=FIGURES[p.name]) for p in PARTS}
    return Run(device, False, parts | {name.replace("__", "."): r for name, r in records.items()})


def tables_of(text: str) -> list[list[str]]:
    blocks = re.findall(r"(?:^\|.*\n?)+", text, flags=re.M)
    return [block.strip().splitlines() for block in blocks]


def test_a_whole_run_gives_every_table_and_misses_nothing():
    text = report(a_run())
    assert "$" not in text and "Not measured" not in text and "figures mean nothing" not in text
    blocks = tables_of(text)
    assert len(blocks) == 8
    for lines in blocks:
        assert len(lines) >= 3
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
    assert (
        "| generated | cpu (numba) | 4 | 1,000 | 24.50 | 0.800 | 0.91 | 61 | 12,345 | 678 |" in text
    )
    assert "3.0e-04 (quats)" in text and "12 at a time for compute capability 9.0" in text
    assert r"tests.x.test_y: it | broke" in text and "2 skipped: gsplat 1.5 differs" in text


def test_a_run_that_measured_nothing_says_so_of_every_part():
    text = report(Run("cuda", False))
    assert text.count("**Not measured**: the run had not come to it.") == len(PARTS)


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (Record(FAILED, why="ValueError: x"), "**Not measured**: failed: ValueError: x."),
        (Record(NO_TIME, why="2 s were left"), "**Not measured**: no time left: 2 s were left."),
        (
            Record(LATE, why="ended after 75 s", figures=FIGURES["steps"]),
            "**Not measured in full**: beyond its deadline: ended after 75 s.",
        ),
    ],
)
def test_a_part_that_was_not_measured_says_why_and_keeps_what_it_had(record, said):
    text = report(a_run(steps=record))
    assert said in text
    assert ("| Splatfacto | 10.00 (9.00 - 12.00) | 1.00 | 1,234 |" in text) == bool(record.figures)


def test_one_training_alone_is_shown_beside_what_became_of_the_other():
    text = report(a_run(training__cpu=Record(FAILED, why="out of memory")))
    assert "| cuda (gsplat) |" in text and "| cpu (numba) |" not in text
    assert "**Not measured**: failed: out of memory." in text


def test_a_stand_in_says_first_that_its_figures_mean_nothing():
    assert "Stand-in: figures mean nothing" in report(a_run("cpu")).split("## ")[0]


@pytest.mark.parametrize(("ratio", "verdict"), [(1.15, "reached"), (1.16, "not reached")])
def test_the_aim_for_a_step_is_judged(ratio, verdict):
    rows = [dict(row) for row in FIGURES["steps"]["rows"]]
    rows[1]["ratio"] = ratio
    text = report(a_run(steps=Record(MEASURED, figures={"rows": rows})))
    assert f"wanted is 1.15 at most: {verdict} ({ratio:.2f})." in text
