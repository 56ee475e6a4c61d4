"""The compiled search decides what the readable statements of `regions` do.

Where both add in the same order, or in float64 and round once, bits are asked for. Averages of
pixels are added in another order, in float32: bounds on them are derived below, and so is which
cells may then fall to the other side of a threshold.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.numba_kernels import runtime
from desplat_ns.calibration.timing import all_cores, threads
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.separation import regions, residuals, search
from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled
from desplat_ns.separation.regions import Comparison, StaticView
from desplat_ns.separation.residuals import ResidualStats

EPS = torch.finfo(torch.float32).eps
CONFIG = DistractorConfig(start="residual")
SIZES = [(60, 40), (61, 43), (181, 239), (480, 270), (333, 1001), (1203, 805)]
"""Width and height. A cell is a pixel in the first two, where nothing is averaged."""


@dataclasses.dataclass
class Case:
    """A photo beside the static scene, under a mask or none."""

    photo: Float[Tensor, "H W 3"]
    static: StaticView
    stats: ResidualStats
    counted: Bool[Tensor, "rows columns"] | None = None

    @property
    def size(self) -> tuple[int, int]:
        return self.photo.shape[1], self.photo.shape[0]

    def seen_by(self, module) -> tuple[Comparison, ResidualStats]:
        return module.compare(self.photo, self.static, self.stats, self.counted)


def generated(width: int, height: int, masked: bool = False, count: int = 5000) -> Case:
    """Blurred noise; in front of it a thing of one colour, and a light."""
    rng = torch.Generator().manual_seed(width + height)
    noise = torch.rand(1, 3, height // 8 + 2, width // 8 + 2, generator=rng)
    scene = F.interpolate(noise, size=(height, width), mode="bicubic")[0].permute(1, 2, 0)
    rgb = (scene + 0.02 * torch.randn(scene.shape, generator=rng)).clamp(0, 1)
    photo = scene.clone()
    photo[height // 4 : height // 2, : width // 2] = torch.tensor([0.9, 0.1, 0.8])
    photo[height // 2 : height // 3 * 2, width // 2 :] += 0.3
    photo = photo.clamp(0, 1)
    return case_of(photo, rgb, rng, count, masked)


def case_of(photo: Tensor, rgb: Tensor, rng: torch.Generator, count: int, masked: bool) -> Case:
    """Gaussians with a memory, some of them beyond the image or hidden."""
    height, width = photo.shape[:2]
    means2d = torch.rand(count, 2, generator=rng) * 1.2 - 0.1
    visible, opacities = torch.rand(2, count, generator=rng)
    static = StaticView(rgb, means2d * torch.tensor([width, height]), visible > 0.1, opacities)
    usual = 0.3 * torch.randn(count, generator=rng)
    stats = ResidualStats(usual, torch.randint(0, 9, (count,), generator=rng).float(), 40, 8)
    if not masked:
        return Case(photo, static, stats)
    mask = torch.ones(height, width, 1, dtype=torch.bool)
    mask[: height // 3, width // 3 : width // 2] = False
    photo, counted = regions.apply_mask(photo, rgb, mask)
    return Case(photo, static, stats, counted)


def real(folder: Path, number: str, masked: bool) -> Case:
    """A photo with something in the way; the static scene is one of the same pose, blurred."""
    images = folder / "images"
    names = (f"clutter_{number}.jpg", f"clean_{number}.jpg")
    photo, clean = (cv2.imread(str(images / name))[..., ::-1] / np.float32(255) for name in names)
    photo, clean = (cv2.resize(image, None, fx=0.5, fy=0.5) for image in (photo, clean))
    rgb = torch.from_numpy(cv2.GaussianBlur(clean, (0, 0), 1.5))
    rng = torch.Generator().manual_seed(int(number))
    return case_of(torch.from_numpy(photo), rgb, rng, 20_000, masked)


def assert_same_search(case: Case) -> None:
    """Of all that follows from the averages of pixels; and these differ by rounding."""
    compiled, plain = case.seen_by(search), case.seen_by(regions)
    bound = pooling_bound(case)
    for a, b in zip(pooled_pair(compiled[0]), pooled_pair(plain[0]), strict=True):
        assert (a - b).abs().max() <= bound
    assert_same_memory(case)
    for comparison in (compiled[0], plain[0]):
        region = search.find_regions(comparison, CONFIG)
        expected = regions.find_regions(comparison, CONFIG)
        assert torch.equal(region, expected) or is_on_edge(comparison)


def pooled_pair(comparison: Comparison) -> tuple[Tensor, Tensor]:
    return comparison.static, comparison.photo


def pooling_bound(case: Case) -> float:
    """A mean of numbers in [0, 1], weighted by m rows, then by n columns: weights and products are
    rounded, and m + n sums; by either way, half of EPS each."""
    taps = [len(grid) for grid in search._grid(*case.size, *fine_grid_of(*case.size))[1::2]]
    return (sum(taps) + 4) * EPS


def assert_same_memory(case: Case) -> None:
    """From one residual the same is remembered, to the bit. What is expected depends on a sum over
    all Gaussians, in which torch rounds some log2(N) + 16 times, and this once."""
    width, height = case.size
    grid = grid_of(width, height)
    pair = pooled_pair(case.seen_by(regions)[0])
    residual = residuals.local_residual(*pair, grid)
    scale = torch.tensor([np.float32(grid[0] / width), np.float32(grid[1] / height)])
    static, stats = case.static, case.stats
    excess, memory = search._excess(residual, case.size, static, stats, case.counted)
    rest = (static.visible, static.opacities, stats, case.counted)
    expected, remembered = residuals.excess_residual(residual, static.means2d * scale, *rest)
    assert torch.equal(memory.usual, remembered.usual)
    assert torch.equal(memory.times_seen, remembered.times_seen)
    assert memory.visits == remembered.visits
    assert excess.level == expected.level
    largest = float(stats.usual.abs().max())
    typical = 2 * (math.log2(len(stats.usual)) + 16) * EPS * largest
    factor = float(excess.level) * math.exp(largest) * (typical + 8 * EPS) + 2 * EPS
    assert (excess.values - expected.values).abs().max() <= factor


def is_on_edge(comparison: Comparison) -> bool:
    """Whether a cell's detail is within the rounding of its mean over fine cells, so that it may
    fall to either side."""
    rows, columns = comparison.excess.values.shape
    alike = regions.shared_detail(comparison.static, comparison.photo)
    means = pooled(alike[..., None], (columns, rows))[0]
    return bool(((means - CONFIG.shared_detail).abs() <= 8 * EPS).any())


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("size", SIZES)
def test_it_decides_as_the_statements_do(size, masked):
    case = generated(*size, masked=masked)
    assert_same_search(case)
    assert 0 < search.find_regions(case.seen_by(search)[0], CONFIG).float().mean() < 0.9


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("number", ["0001", "0012", "0027"])
def test_it_decides_as_the_statements_do_on_real_photos(data_folder, number, masked):
    assert_same_search(real(data_folder("fox_cluttered"), number, masked))


@pytest.mark.parametrize("size", SIZES)
def test_from_pixels_on_no_more_cells_differ_than_rounding_can_move(size):
    """Cells are counted whose excess is as near to a threshold as rounding moves it, or whose
    detail is; each may take the cells with it over which a region is explained by colours."""
    case = generated(*size)
    (compiled, _), (plain, _) = case.seen_by(search), case.seen_by(regions)
    region = search.find_regions(compiled, CONFIG)
    differing = int((region != regions.find_regions(plain, CONFIG)).sum())
    if fine_grid_of(*size) == size:
        assert differing == 0
    assert differing <= regions.OUTLINE_WINDOW**2 * movable(plain, pooling_bound(case))


def movable(comparison: Comparison, bound: float) -> int:
    """Cells that may fall to the other side where colours are off by the bound.

    A residual is off by twice as much, its level as well, and so is the excess by what is expected
    relative to the level, below 5 here. Means of products are off by 2 bounds, and variances and
    covariances by 4: a correlation by 8 over the geometric mean of the variances.
    """
    excess, level = comparison.excess.values, float(comparison.excess.level)
    most = CONFIG.strong_excess
    needed = min(max(CONFIG.strong_levels * level, CONFIG.settled_share * most), most)
    near = (excess - CONFIG.weak_excess).abs() <= 12 * bound
    near |= (excess - needed).abs() <= (12 + 2 * CONFIG.strong_levels) * bound
    rows, columns = excess.shape
    alike = regions.shared_detail(comparison.static, comparison.photo)
    means = pooled(alike[..., None], (columns, rows))[0]
    near |= (means - CONFIG.shared_detail).abs() <= 8 * bound / regions.DETAIL_NOISE
    return int(near.sum())


@pytest.mark.skipif(all_cores() < 2, reason="needs two cores")
@pytest.mark.parametrize("size", [(61, 43), (181, 239), (3, 200), (1203, 805)])
def test_the_bits_are_the_same_for_any_number_of_threads(size):
    case, results = generated(*size, masked=True), []
    for number in (1, 2):
        with threads(number):
            assert numba.get_num_threads() == number
            comparison, stats = case.seen_by(search)
            kept = (*pooled_pair(comparison), comparison.excess.values, stats.usual)
            results.append((*kept, search.find_regions(comparison, CONFIG)))
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


@pytest.mark.parametrize("bands", [2, 3, 7, 40])
def test_more_bands_than_threads_give_the_same_bits(bands, monkeypatch):
    """As on a machine with so many cores, some of which get no row."""
    case = generated(181, 239)
    whole = case.seen_by(search)[0]
    monkeypatch.setattr(runtime, "num_workers", lambda: bands)
    parts = case.seen_by(search)[0]
    assert torch.equal(parts.excess.values, whole.excess.values)
    region = search.find_regions(parts, CONFIG)
    monkeypatch.undo()
    assert torch.equal(region, search.find_regions(whole, CONFIG))


def test_a_view_without_gaussians_or_with_nothing_counted_is_searched():
    none = generated(61, 43, count=0)
    (comparison, _), (expected, _) = none.seen_by(search), none.seen_by(regions)
    assert torch.equal(comparison.excess.values, expected.excess.values)
    case = generated(61, 43)
    case.counted = torch.zeros(43, 61, dtype=torch.bool)
    comparison, stats = case.seen_by(search)
    assert comparison.excess.level == np.float32(residuals.MIN_RESIDUAL)
    assert torch.equal(stats.usual, case.stats.usual)
    assert not search.find_regions(comparison, CONFIG).any()


def test_where_numba_is_missing_or_numbers_are_float64_the_statements_decide(monkeypatch):
    case = generated(60, 40)
    kernels = search._kernels()
    monkeypatch.setattr(search, "_launch", None)
    monkeypatch.setattr(search, "_kernels", lambda: None)
    comparison, _ = case.seen_by(search)
    assert search.find_regions(comparison, CONFIG).any()
    monkeypatch.setattr(search, "_kernels", lambda: kernels)
    static = dataclasses.replace(case.static, rgb=case.static.rgb.double())
    double = Case(case.photo.double(), static, case.stats)
    assert search.find_regions(double.seen_by(search)[0], CONFIG).any()
