"""Decoded photos, of which a bounded number of bytes is held at a time.

nerfstudio 1.1.5 holds all of them: 1,000 photos of 12 megapixels are 36 GB. Here a photo is read in
the background before its turn comes, and goes when others need its room.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from copy import deepcopy
from itertools import accumulate, islice
from threading import Lock
from typing import Any

import psutil
import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.cores import cores
from desplat_ns.data.dataset import CaptureDataset, ImageType, Photo

SHARE = 0.4
"""Of the memory that nobody uses: what decoded photos may take by themselves."""

AHEAD = 16
"""Photos that are read before their turn, at most."""

MOST_READERS = 8
"""Photos that are read at once, at most."""


class PhotoMemory:
    """What the photos of a capture take once they are decoded, and what there is room for."""

    def __init__(
        self,
        splits: Mapping[str, CaptureDataset],
        image_type: ImageType,
        device: torch.device | str,
        gigabytes: float | None,
    ):
        """Reads a photo, whose bytes for a pixel are taken for all.

        Args:
            device: where photos are kept if they can be.
            gigabytes: that photos may take wherever they are; None for `SHARE` of what is free.
        """
        sample = next(iter(splits.values())).get_data(0, image_type)
        values = sum(value.nbytes for value in sample.values() if isinstance(value, Tensor))
        each = values / math.prod(sample["image"].shape[:2])
        self.sizes = {
            name: [math.ceil(width * height * each) for width, height in split.sizes]
            for name, split in splits.items()
        }
        """Bytes of each photo, by split."""
        self.needed = sum(map(sum, self.sizes.values()))
        """Bytes of all photos."""
        room = None if gigabytes is None else 1e9 * gigabytes
        self.room: float = room or SHARE * psutil.virtual_memory().available
        """Bytes of the machine's memory that photos may take."""
        device = torch.device(device)
        is_cuda = device.type == "cuda"
        on_device = room or (SHARE * torch.cuda.mem_get_info(device)[0] if is_cuda else self.room)
        self.fit_device, self.fit = self.needed <= on_device, self.needed <= self.room
        """Whether all photos fit into the device's memory, and into the machine's."""

    def room_of(self, split: str) -> int:
        """Bytes that the photos of a split may take: its share by what all of them need."""
        return int(self.room * sum(self.sizes[split]) / self.needed)


class BoundedPhotos(Sequence[Photo]):
    """Photos by their numbers, as a list of all would give them, in bounded memory.

    As many as there is room for stay once they are read; the others are read before their turn and
    go after it. In rounds of random order no choice of what stays could find more in memory, but
    for the room of those that come next.
    """

    def __init__(
        self,
        read: Callable[[int], Photo],
        sizes: Sequence[int],
        most: int,
        upcoming: Callable[[int], Iterable[int]],
    ):
        """Args:
        read: gives a photo; called by several threads at once.
        sizes: bytes of each photo.
        most: bytes that are held; one photo is held in any case.
        upcoming: numbers of the photos that will be asked for after one, in their order, as far
            as that is known.
        """
        self._read, self._sizes, self._upcoming = read, sizes, upcoming
        self._ahead = max(0, min(AHEAD, most // max(sizes) - 1))
        room = most - (1 + self._ahead) * max(sizes)
        self._stay = {photo for photo, used in enumerate(accumulate(sizes)) if used <= room}
        self._held: dict[int, Future[Photo]] = {}
        self._lock = Lock()
        readers = min(MOST_READERS, cores())
        self._pool = ThreadPoolExecutor(readers, thread_name_prefix="photos")

    def __len__(self) -> int:
        return len(self._sizes)

    def __getitem__(self, index: Any) -> Photo:
        """A photo; those that come next begin to be read.

        Raises:
            IndexError: there is no such photo.
            Exception: whatever reading raises; asked for again, the photo is read again.
        """
        index = range(len(self))[index]
        with self._lock:
            wanted = [index, *islice(self._upcoming(index), self._ahead)]
            for photo in self._held.keys() - self._stay - {*wanted}:
                del self._held[photo]
            for photo in wanted:
                if photo not in self._held:
                    self._held[photo] = self._pool.submit(self._read, photo)
            future = self._held[index]
        try:
            return future.result()
        except Exception:
            with self._lock:
                self._held.pop(index, None)
            raise


class PhotosOfCameras(Sequence[tuple[Cameras, Photo]]):
    """Cameras with their photos on a device, each photo got when it is asked for."""

    def __init__(self, cameras: Cameras, photos: Sequence[Photo], device: torch.device | str):
        self._cameras, self._photos = deepcopy(cameras).to(device), photos
        self._device = device

    def __len__(self) -> int:
        return len(self._photos)

    def __getitem__(self, index: Any) -> tuple[Cameras, Photo]:
        photo = self._photos[index]
        photo = {**photo, "image": photo["image"].to(self._device)}
        return self._cameras[index : index + 1], photo
