"""In a guise, a process believes in another machine."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from lab.documents import CHECKOUT
from lab.guises.__main__ import PARTS, environment
from lab.guises.guises import GUISES

ASKED = """
import json, os
import numba, numpy, torch
from desplat_ns.photo_tourism.config import has_bfloat16
print(json.dumps({
    "torch": torch.backends.cpu.get_cpu_capability(),
    "bfloat16": has_bfloat16("cpu"),
    "numba": numba.config.CPU_NAME,
    "cores": [os.cpu_count(), len(os.sched_getaffinity(0)), numba.config.NUMBA_NUM_THREADS],
    "gpu": torch.cuda.is_available(),
}))
"""


def answer(name: str, **variables: str) -> dict:
    (guise,) = [guise for guise in GUISES if guise.name == name]
    there = environment(guise) | {"CUDA_VISIBLE_DEVICES": "0"} | variables
    there.pop("NUMBA_NUM_THREADS", None)
    command = [sys.executable, "-c", ASKED]
    done = subprocess.run(command, cwd=CHECKOUT, env=there, capture_output=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("avx2", {"torch": "AVX2", "numba": "haswell", "bfloat16": False, "gpu": False}),
        ("no-vectors", {"torch": "DEFAULT", "numba": "haswell", "bfloat16": False}),
        ("no-bfloat16", {"bfloat16": False}),
        ("one-core", {"cores": [1, 1, 1]}),
        ("many-cores", {"cores": [16, 16, 16]}),
        ("gpu", {"gpu": True}),
    ],
)
def test_a_process_believes_in_the_other_machine(name, expected):
    answers = answer(name)
    assert {key: answers[key] for key in expected} == expected


def test_a_gpu_that_is_hidden_is_not_there():
    assert not answer("gpu", CUDA_VISIBLE_DEVICES="")["gpu"]


def test_the_part_that_computes_exists():
    assert all((CHECKOUT / path).exists() for path in PARTS["arithmetic"])
