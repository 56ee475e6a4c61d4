"""Embeddings of test images in a file, with what says to which trained model they belong."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from desplat_ns.errors import CheckpointError
from desplat_ns.files.whole import draft_of

FORMAT = 1


def digest_of(module: nn.Module) -> str:
    """SHA-256 over a module's parameters: embeddings mean nothing to any other model."""
    digest = hashlib.sha256()
    for name, value in sorted(module.state_dict().items()):
        digest.update(name.encode())
        digest.update(value.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def save_embeddings(path: Path, embeddings: Mapping[str, Tensor], model_digest: str) -> None:
    """Write embeddings [E] by image name as .npz: names, a matrix of rows, and the digest."""
    names = sorted(embeddings)
    rows = [embeddings[name].detach().cpu().numpy() for name in names]
    with draft_of(path) as draft, draft.open("wb") as file:
        np.savez(
            file,
            format=FORMAT,
            model=model_digest,
            names=np.array(names),
            embeddings=np.array(rows),
        )


def load_embeddings(path: Path, model_digest: str, device: torch.device) -> dict[str, Tensor]:
    """What `save_embeddings` wrote.

    Raises:
        CheckpointError: the file is missing, is none of ours, or belongs to another model.
    """
    advice = "Write it anew with `desplat-eval --save-embeddings FILE --overwrite`."
    try:
        with np.load(path, allow_pickle=False) as saved:
            found = {name: saved[name] for name in ("model", "names", "embeddings")}
    except FileNotFoundError as error:
        raise CheckpointError(f"There is no file of embeddings at '{path}'. {advice}") from error
    except (PermissionError, MemoryError):
        raise
    except Exception as error:  # damaged bytes raise whatever numpy stumbles over
        raise CheckpointError(
            f"'{path}' is no file of embeddings, or a damaged one ({error}). {advice}"
        ) from error
    if str(found["model"]) != model_digest:
        raise CheckpointError(
            f"The embeddings in '{path}' belong to another model, or to another step of this one. "
            f"{advice}"
        )
    names, rows = found["names"], found["embeddings"]
    is_matrix = rows.ndim == 2 and rows.dtype == np.float32 and names.shape == rows.shape[:1]
    if not is_matrix or not np.isfinite(rows).all():
        raise CheckpointError(
            f"'{path}' is a damaged file of embeddings: {names.shape} names, {rows.dtype} numbers "
            f"{rows.shape}, of which {_num_finite(rows)} are finite. {advice}"
        )
    return dict(zip(map(str, names), torch.from_numpy(rows).to(device), strict=True))


def _num_finite(rows: np.ndarray) -> int:
    return int(np.isfinite(rows).sum()) if np.issubdtype(rows.dtype, np.number) else 0
