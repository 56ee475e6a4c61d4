"""Decoded photos, of which a bounded number is held at a time; nerfstudio 1.1.5 holds all of them:
1,000 photos of 12 megapixels are 36 GB."""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any

import torch
from torch import Tensor

from desplat_ns.core.cores import cores, memory
from desplat_ns.data.dataset import CaptureDataset, Photo

SHARE = 0.4
"""Of the memory that nobody uses: what decoded photos may take by themselves."""

AHEAD = 16
"""Photos that are read before their turn, at most."""


def photo_bytes(dataset: CaptureDataset) -> list[int]:
    """Bytes of each decoded photo. The first is read, and its bytes for a pixel taken for all."""
    sample = dataset.get_data(0, "uint8")
    values = sum(value.nbytes for value in sample.values() if isinstance(value, Tensor))
    each = values / math.prod(sample["image"].shape[:2])
    return [math.ceil(width * height * each) for width, height in dataset.sizes]


def free_memory(device: torch.device) -> int:
    """Bytes that nobody uses where photos are held: the machine's, or the GPU's if fewer."""
    free = memory()[1]
    return min(free, torch.cuda.mem_get_info(device)[0]) if device.type == "cuda" else free


class BoundedPhotos(Sequence[Photo]):
    """Photos by their numbers, as a list of all would give them, in bounded memory: as many as
    there is room for stay; the others are read before their turn and go after it."""

    def __init__(
        self,
        read: Callable[[int], Photo],
        count: int,
        most: int,
        upcoming: Callable[[], Iterable[int]],
    ):
        """Args:
        read: gives a photo; called by several threads at once.
        count: of all photos.
        most: photos that are held; one is held in any case.
        upcoming: gives numbers of the photos that will be asked for next, in their order.
        """
        self._read, self._count, self._upcoming = read, count, upcoming
        self._ahead = max(0, min(AHEAD, most - 1))
        self._stay = range(most - 1 - self._ahead)
        self._held: dict[int, Future[Photo]] = {}
        self._pool = ThreadPoolExecutor(min(AHEAD, cores()), thread_name_prefix="photos")

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Photo:
        """A photo; those that come next begin to be read.

        Raises:
            IndexError: there is no such photo.
            Exception: whatever reading raises; asked for again, the photo is read again.
        """
        index = range(len(self))[index]
        wanted = [index, *islice(self._upcoming(), self._ahead)]
        for photo in self._held.keys() - {*self._stay, *wanted}:
            del self._held[photo]
        for photo in wanted:
            if photo not in self._held:
                self._held[photo] = self._pool.submit(self._read, photo)
        try:
            return self._held[index].result()
        except Exception:
            del self._held[index]
            raise
