from __future__ import annotations

import os
import platform
import threading

import numba
import numpy as np
import pytest
import torch

from desplat_ns.backend.numba_kernels import runtime as numba_runtime
from desplat_ns.backend.numba_kernels.runtime import (
    fma,
    kernel,
    launching,
    prefetch,
    scratch,
    take,
)


def double(x):
    return 2 * x


@pytest.mark.filterwarnings("ignore::numba.NumbaPerformanceWarning")
def test_a_kernel_works_where_no_cache_folder_can_be_written(monkeypatch):
    compile_ = numba.njit

    def refuse_to_cache(*args, cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function 'double': no locator available")
        return compile_(*args, **options)

    monkeypatch.setattr(numba, "njit", refuse_to_cache)
    monkeypatch.setattr(numba_runtime, "kernels", kernels := [])
    assert kernel(parallel=True)(double)(4) == 8
    assert kernels[0].stats.cache_path is None


def test_copies_older_than_any_file_of_kernels_are_dropped(tmp_path):
    old, new = tmp_path / "module.double.nbi", tmp_path / "module.treble.nbi"
    for path, age in ((old, -10), (new, 10)):
        path.touch()
        when = numba_runtime._NEWEST_SOURCE + age
        os.utime(path, (when, when))
    numba_runtime._drop_stale(str(tmp_path))
    assert not old.exists()
    assert new.exists()


def test_the_first_launch_of_a_process_has_missing_kernels_compiled_and_no_later_one(monkeypatch):
    asked = []
    monkeypatch.setattr(numba_runtime, "_is_ready", False)
    monkeypatch.setattr(numba_runtime, "before_first_launch", [lambda: asked.append(True)])
    for _ in range(2):
        with launching():
            pass
    assert asked == [True]


@numba.njit(nogil=True)
def take_all(counter, marks):
    place = take(counter)
    while place < marks.size:
        marks[place] += 1
        place = take(counter)


def test_no_piece_of_work_is_taken_twice_or_left_out():
    counter, marks = np.zeros(1, np.int64), np.zeros(200_000, np.int32)
    take_all(np.zeros(1, np.int64), np.zeros(1, np.int32))  # compiles
    threads = [threading.Thread(target=take_all, args=(counter, marks)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (marks == 1).all()


@numba.njit
def call_fma(a, b, c):
    return fma(a, b, c)


def test_fma_rounds_once():
    a = np.float32(1 + 2**-12)
    # a^2 = 1 + 2^-11 + 2^-24; rounded to float32 first, the last term would be lost.
    assert call_fma(a, a, np.float32(-1 - 2**-11)) == np.float32(2**-24)


@numba.njit
def call_prefetch(array, at):
    prefetch(array, at)


def test_prefetching_beyond_the_array_does_no_harm():
    array = np.arange(3, dtype=np.float32)
    for at in (0, 2, -1_000_000_000, 1_000_000_000):
        call_prefetch(array, at)
    assert array.tolist() == [0, 1, 2]


def test_scratch_memory_is_kept_and_grows_where_it_must():
    first = scratch(1000)
    assert first.size == 1000 and first.dtype == np.float32
    assert np.shares_memory(first, scratch(10))
    larger = scratch(3 * numba_runtime._scratch.size)
    assert np.shares_memory(larger, scratch(1000))


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another allocator")
def test_a_large_block_that_was_freed_is_used_again_without_asking_the_system(monkeypatch):
    import resource

    for name in [n for n in os.environ if n.startswith(("MALLOC_", "GLIBC_TUNABLES"))]:
        monkeypatch.delenv(name)
    numba_runtime._keep_freed_memory()
    size, largest_page = 64 << 20, 2 << 20

    def page_faults() -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        torch.ones(size // 4)
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    # As many at least if it were mapped anew. Now and then a free place is just too small for it.
    assert min(page_faults() for _ in range(5)) < size / largest_page
