"""Figures of the paper's tables, as far as its supplement has them: Tables A5 to A9.

The tables of the main text are not in it, so that nothing of RobustNeRF's and On-the-go's PSNR,
SSIM and LPIPS is here. Rows are called as in the text: DeSplat, and DeSplat-A without background.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

MEAN = "mean"
"""The column of means over all scenes of a table."""

BOTH_SETS = ("Statue", "Android", "Crab (1)", "Crab (2)", "Yoda")
BOTH_SETS += ("Mountain", "Fountain", "Corner", "Patio", "Spot", "Patio-High")
"""Columns of Tables A7 to A9, before a last one without a name, which holds their mean."""

IMAGE_METRICS = ("psnr", "ssim", "lpips")


@dataclass(frozen=True)
class Published:
    """A table of the paper, or the rows of it that are of one kind."""

    scenes: tuple[str, ...]
    metrics: tuple[str, ...]
    """Of each scene, by the names of `tables`."""
    rows: Mapping[str, tuple[float | None, ...]]
    """Figures scene by scene; None where the paper has a dash."""

    def figure(self, row: str, scene: str, metric: str) -> float | None:
        """None where there is none."""
        if row not in self.rows or scene not in self.scenes or metric not in self.metrics:
            return None
        place = self.scenes.index(scene) * len(self.metrics) + self.metrics.index(metric)
        return self.rows[row][place]


def _seconds(time: str) -> float:
    """Of `minutes:seconds` or `hours:minutes:seconds`."""
    seconds = 0
    for part in time.split(":"):
        seconds = 60 * seconds + int(part)
    return float(seconds)


def _rows(text: str, is_time: bool = False) -> dict[str, tuple[float | None, ...]]:
    """Lines `name | figures`."""
    read = _seconds if is_time else float
    lines = (line.split("|") for line in text.strip().splitlines())
    return {
        name.strip(): tuple(None if word == "-" else read(word) for word in figures.split())
        for name, figures in lines
    }


_A5 = """
Splatfacto     | 19.50 0.885 0.183  17.15 0.831 0.210  17.63 0.696 0.334
Splatfacto-W   | 26.87 0.932 0.124  22.53 0.876 0.158  22.66 0.769 0.224
Splatfacto-W-A | 27.50 0.930 0.130  22.62 0.876 0.156  22.81 0.770 0.228
Splatfacto-W-T | 26.16 0.925 0.131  22.78 0.878 0.155  22.88 0.772 0.228
SWAG           | 26.33 0.929 0.139  21.16 0.860 0.185  23.10 0.815 0.208
GS-W           | 27.96 0.932 0.086  23.24 0.863 0.130  22.91 0.801 0.156
Wild-GS        | 29.65 0.933 0.095  24.99 0.878 0.127  24.45 0.808 0.162
WildGaussians  | 27.77 0.927 0.133  22.56 0.859 0.177  23.63 0.766 0.228
DeSplat-A      | 26.72 0.918 0.132  22.28 0.876 0.159  23.06 0.774 0.229
DeSplat        | 25.04 0.920 0.142  20.14 0.868 0.178  23.31 0.775 0.226
"""

_A6 = """
Splatfacto | 24.99 0.761 0.171  27.24 0.853 0.096  26.30 0.771 0.164  31.87 0.921 0.164 \
 28.69 0.899 0.166  31.30 0.920 0.107  31.72 0.938 0.137
DeSplat    | 24.80 0.756 0.171  27.03 0.852 0.096  25.54 0.751 0.176  31.51 0.920 0.164 \
 28.29 0.897 0.166  30.93 0.919 0.105  31.42 0.936 0.138
"""

_A7 = """
Splatfacto | 38.19 51.95 25.38 26.86 24.19 123.63 145.82 67.45 73.81 70.76 106.83 68.62
Splatfacto-W-light | 42.86 53.49 40.13 37.57 23.95 139.90 165.23 64.01 74.81 85.04 114.11 76.46
SLS-mlp | 110.14 129.38 34.41 47.40 54.50 108.85 264.34 142.25 128.09 107.20 192.79 119.94
SLS-mlp (+UBP) | 42.24 56.79 15.11 18.90 23.59 53.48 109.61 45.70 58.06 39.56 60.45 47.59
WildGaussians | - - - - - 215.64 480.52 232.98 140.14 124.37 230.31 237.33
DeSplat | 46.99 67.80 35.89 39.40 38.75 118.27 163.73 67.03 55.69 61.28 102.52 72.49
"""

_A7_DISTRACTORS = """
DeSplat | 16.82 18.15 6.35 7.23 11.24 23.26 12.51 21.03 38.51 40.33 35.65 21.01
"""

_A8 = """
Splatfacto | 9:32 11:42 9:02 10:43 10:17 9:46 10:34 8:56 8:55 9:02 11:11 9:58
Splatfacto-W-light | 24:25 24:08 23:44 25:26 25:24 24:13 24:53 15:59 17:38 19:05 20:44 22:19
SLS-mlp | 25:21 24:52 21:57 25:33 25:02 27:39 29:06 22:47 19:31 22:16 21:41 24:09
SLS-mlp (+UBP) | 24:09 23:13 21:59 25:16 25:55 26:22 27:14 19:54 18:16 19:56 21:08 23:02
WildGaussians | - - - - - 58:06 1:20:30 58:41 52:10 1:00:46 58:49 1:01:30
DeSplat | 13:40 13:33 13:03 14:01 13:26 11:36 14:20 10:39 12:11 12:43 13:10 12:56
"""

# The mean of Splatfacto's eleven is 94.10; the paper prints 94.01.
_A9 = """
Splatfacto | 91.04 72.98 102.85 103.03 99.83 102.87 90.32 101.58 101.60 89.85 79.13 94.01
DeSplat | 104.98 101.86 109.16 112.02 114.11 110.16 89.12 136.13 108.24 96.73 101.16 107.61
"""

_TOURISM = ("Brandenburg Gate", "Sacre Coeur", "Trevi Fountain")
_360 = ("bicycle", "garden", "stump", "room", "counter", "kitchen", "bonsai")
_WITH_MEAN = (*BOTH_SETS, MEAN)

PUBLISHED: dict[str, tuple[Published, ...]] = {
    "A5": (Published(_TOURISM, IMAGE_METRICS, _rows(_A5)),),
    "A6": (Published(_360, IMAGE_METRICS, _rows(_A6)),),
    "A7": (
        Published(_WITH_MEAN, ("static_mb",), _rows(_A7)),
        Published(_WITH_MEAN, ("distractor_mb",), _rows(_A7_DISTRACTORS)),
    ),
    "A8": (Published(_WITH_MEAN, ("train_seconds",), _rows(_A8, is_time=True)),),
    "A9": (Published(_WITH_MEAN, ("fps_with_metrics",), _rows(_A9)),),
}
"""By the number of the table. A8 in seconds; A9 counts the metrics' time, as ns-eval does."""


def published(table: str, row: str, scene: str, metric: str) -> float | None:
    """A figure of the paper; None where there is none."""
    figures = (part.figure(row, scene, metric) for part in PUBLISHED.get(table, ()))
    return next((figure for figure in figures if figure is not None), None)


def rows_of(table: str) -> tuple[str, ...]:
    """All rows of a table of the paper."""
    return tuple(dict.fromkeys(row for part in PUBLISHED.get(table, ()) for row in part.rows))
