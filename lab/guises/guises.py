"""Sets of environment variables under which this machine is like another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

PRETEND = Path(__file__).with_name("pretend")
"""On the path of Python's imports its `sitecustomize` is read when an interpreter starts."""


@dataclass(frozen=True)
class Guise:
    """One machine that this one can look like."""

    name: str
    title: str
    """What is tried, for the table."""
    variables: Mapping[str, str] = field(default_factory=dict)


NO_BFLOAT16 = {"DESPLAT_NS_PRETEND_NO_BFLOAT16": "1"}

HASWELL = NO_BFLOAT16 | {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
    "OPENBLAS_CORETYPE": "Haswell",
}
"""The first processor with AVX2, for all but torch."""


def _cores(number: int) -> dict[str, str]:
    """A machine of so many cores, although threads share those that there are."""
    return {"DESPLAT_NS_PRETEND_CORES": str(number), "OMP_NUM_THREADS": str(number)}


GUISES = (
    Guise("as-is", "this machine as it is"),
    Guise(
        "no-bfloat16",
        "AVX-512 without bfloat16",
        NO_BFLOAT16 | {"ONEDNN_MAX_CPU_ISA": "AVX512_CORE_VNNI"},
    ),
    Guise(
        "avx2",
        "AVX2 and no more",
        HASWELL | {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2", "MKL_CBWR": "AVX2"},
    ),
    Guise(
        "no-vectors",
        "torch without vector instructions",
        HASWELL
        | {
            "ATEN_CPU_CAPABILITY": "default",
            "ONEDNN_MAX_CPU_ISA": "SSE41",
            "MKL_CBWR": "COMPATIBLE",
        },
    ),
    Guise("one-core", "one core", _cores(1)),
    Guise("many-cores", "sixteen cores", _cores(16)),
    Guise("gpu", "a GPU, which the suite hides", {"DESPLAT_NS_PRETEND_GPU": "1"}),
)
"""By what decides: instructions, cores, a GPU."""
