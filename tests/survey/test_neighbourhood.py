from __future__ import annotations

import numpy as np

from desplat_ns.survey.neighbourhood import near_means
from desplat_ns.survey.views import View

VIEW = View(
    np.eye(3),
    np.zeros(3),
    np.array([90.0, 90.0]),
    np.array([48.0, 36.0]),
    96,
    72,
    np.zeros(6),
    False,
)


def test_the_mean_is_that_of_the_others_in_three_by_three_cells():
    places = np.array([[1.0, 1.0], [3.0, 1.0], [5.9, 1.0], [6.1, 1.0], [90.0, 60.0]])
    mean, count = near_means(VIEW, places, np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    # Cells are 2 pixels wide: columns 0, 1, 2, 3 and one far away.
    np.testing.assert_allclose(count, [1, 2, 2, 1, 0])
    np.testing.assert_allclose(mean, [2, 2, 3, 3, 0])
