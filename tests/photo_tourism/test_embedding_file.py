"""Embeddings come back as they were written, and to no other model."""

from pathlib import Path

import pytest
import torch
from torch import nn

from desplat_ns.errors import CheckpointError
from desplat_ns.photo_tourism.embedding_file import digest_of, load_embeddings, save_embeddings

CPU = torch.device("cpu")


def test_what_was_saved_comes_back(tmp_path: Path):
    embeddings = {"b.jpg": torch.randn(4), "a/ü.jpg": torch.randn(4)}
    save_embeddings(tmp_path / "new" / "e.npz", embeddings, "digest")
    loaded = load_embeddings(tmp_path / "new" / "e.npz", "digest", CPU)
    assert loaded.keys() == embeddings.keys()
    assert all(torch.equal(loaded[name], embeddings[name]) for name in embeddings)


def test_another_model_is_refused(tmp_path: Path):
    save_embeddings(tmp_path / "e.npz", {"a": torch.zeros(4)}, digest_of(nn.Linear(2, 2)))
    with pytest.raises(CheckpointError, match="another model"):
        load_embeddings(tmp_path / "e.npz", digest_of(nn.Linear(2, 2)), CPU)


def test_the_digest_changes_with_a_single_number():
    layer = nn.Linear(2, 2)
    before = digest_of(layer)
    assert digest_of(layer) == before
    layer.bias.data[1] += 1e-6
    assert digest_of(layer) != before


@pytest.mark.parametrize("content", [None, b"", b"no archive", b"PK\x03\x04 cut"])
def test_a_file_that_is_none_is_named(tmp_path: Path, content: bytes | None):
    path = tmp_path / "e.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"e\.npz"):
        load_embeddings(path, "digest", CPU)


def test_an_archive_of_something_else_is_named(tmp_path: Path):
    import numpy as np

    np.savez(tmp_path / "e.npz", rows=np.zeros(3))
    with pytest.raises(CheckpointError, match="no file of embeddings"):
        load_embeddings(tmp_path / "e.npz", "digest", CPU)


def test_a_single_array_is_no_archive(tmp_path: Path):
    import numpy as np

    with (tmp_path / "e.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(CheckpointError, match="no file of embeddings"):
        load_embeddings(tmp_path / "e.npz", "digest", CPU)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, number: float):
    embeddings = {"a": torch.zeros(4), "b": torch.tensor([0.0, number, 0.0, 0.0])}
    save_embeddings(tmp_path / "e.npz", embeddings, "digest")
    with pytest.raises(CheckpointError, match=r"of which 7 are finite"):
        load_embeddings(tmp_path / "e.npz", "digest", CPU)


def test_a_damaged_flag_in_the_archive_is_named(tmp_path: Path):
    """zipfile answers one flag with NotImplementedError and another with RuntimeError."""
    path = tmp_path / "e.npz"
    for bit in range(16):
        save_embeddings(path, {"a": torch.zeros(4)}, "digest")
        data = bytearray(path.read_bytes())
        for header, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
            at = data.find(header) + flags
            while at >= flags:
                data[at + bit // 8] ^= 1 << bit % 8
                found = data.find(header, at)
                at = found + flags if found >= 0 else -1
        path.write_bytes(data)
        try:
            load_embeddings(path, "digest", CPU)
        except CheckpointError as error:
            assert "e.npz" in str(error)
