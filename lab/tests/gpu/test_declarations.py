from __future__ import annotations

from pathlib import Path

import pytest
import torch

from lab.gpu.declarations import Parameter, misfits, read_declarations

HEADER = """
namespace gsplat {
std::tuple<torch::Tensor, torch::Tensor> draw_tensor(
    // what is drawn
    const torch::Tensor &means,                // [C, N, 3] or [nnz, 3]
    const at::optional<torch::Tensor> &covars, // [N, 6] optional
    const uint32_t image_width,
    const uint32_t C,
    const float eps2d,
    const bool sort,
    const CameraModelType camera_model,
    const torch::Tensor &radii // [..., N]
);
at::Tensor offsets(
    const at::Tensor isect_ids, // [n_isects]
    const uint32_t image_width
);
"""


@pytest.fixture
def draw(tmp_path: Path) -> tuple[Parameter, ...]:
    header = tmp_path / "cuda" / "csrc" / "bindings.h"
    header.parent.mkdir(parents=True)
    header.write_text(HEADER)
    kernels = read_declarations(tmp_path)
    assert list(kernels) == ["draw", "offsets"] and len(kernels["offsets"]) == 2
    return kernels["draw"]


def values(**other: object) -> list[object]:
    valid = {
        **{"means": torch.zeros(1, 5, 3), "covars": None, "image_width": 48, "C": 1},
        **{"eps2d": 0.3, "sort": True, "camera_model": "PINHOLE"},
        "radii": torch.zeros(1, 5, dtype=torch.int32),
    }
    return list((valid | other).values())


def test_a_header_says_names_types_and_shapes(draw):
    assert [parameter.name for parameter in draw] == [
        *("means", "covars", "image_width", "C", "eps2d", "sort", "camera_model", "radii")
    ]
    assert draw[0].shapes == ("[C, N, 3]", "[nnz, 3]") and not draw[0].is_optional
    assert draw[1].is_optional and draw[1].kind == "Tensor" and draw[4].kind == "float"


def test_a_call_that_fits_has_no_misfit(draw):
    assert misfits("draw", draw, values()) == []
    assert misfits("draw", draw, values(eps2d=1, covars=torch.zeros(5, 6))) == []


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"means": torch.zeros(1, 5, 4)}, "means is [1, 5, 4], not [C, N, 3] or [nnz, 3]"),
        ({"means": torch.zeros(1, 5, 3).double()}, "means is torch.float64, not torch.float32"),
        ({"means": torch.zeros(1, 3, 5).mT}, "means is not contiguous"),
        ({"means": None}, "means is None and not optional"),
        ({"covars": torch.zeros(4, 6)}, "covars is [4, 6], not [N, 6]"),
        ({"radii": torch.zeros(1, 4, dtype=torch.int32)}, "radii is [1, 4], not [..., N]"),
        ({"radii": torch.zeros(1, 5)}, "radii is torch.float32, not torch.int32"),
        ({"image_width": 48.0}, "image_width is of type float, not uint32_t"),
        ({"image_width": -1}, "image_width is -1"),
        ({"image_width": True}, "image_width is of type bool, not uint32_t"),
        ({"C": 2}, "C is 2, not 1"),
        ({"sort": 1}, "sort is of type int, not bool"),
        ({"eps2d": "0.3"}, "eps2d is of type str, not float"),
    ],
)
def test_a_value_that_does_not_fit_is_named(draw, other, said):
    assert misfits("draw", draw, values(**other)) == [f"draw: {said}"]


def test_another_number_of_values_is_said(draw):
    assert misfits("draw", draw, values()[:-1]) == ["draw takes 8 values and is given 7"]


def test_a_folder_without_sources_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"bindings\.h"):
        read_declarations(tmp_path)
