"""Photos in bounded memory are the photos; each is read before its turn, few more than once."""

import random
import threading
from collections.abc import Iterable

import pytest

from desplat_ns.data.photo_cache import AHEAD, BoundedPhotos, Photo

SECONDS = 30
"""After which a thread that did not do something is taken not to do it."""


class Files:
    """What reads photos, and knows which it has read."""

    def __init__(self) -> None:
        self.read: list[int] = []
        self.arrived = threading.Condition()

    def __call__(self, index: int) -> Photo:
        with self.arrived:
            self.read.append(index)
            self.arrived.notify_all()
        return {"image_idx": index}

    def has_read(self, index: int) -> bool:
        """Whether a photo is read, also if that has to be waited for."""
        with self.arrived:
            return self.arrived.wait_for(lambda: index in self.read, SECONDS)


class Rounds:
    """Numbers of photos in rounds of random order, and which are known to come."""

    def __init__(self, count: int):
        self._random, self._count = random.Random(0), count
        self.unseen: list[int] = []

    def upcoming(self) -> Iterable[int]:
        return self.unseen

    def __call__(self, rounds: int) -> Iterable[int]:
        for _ in range(rounds):
            self.unseen = self._random.sample(range(self._count), self._count)
            while self.unseen:
                yield self.unseen.pop(0)


@pytest.mark.parametrize("most", [0, 1, 7, 18, 19, 100])
def test_photos_are_given_as_by_a_list_within_the_bound(most: int):
    rounds = Rounds(20)
    photos = BoundedPhotos(Files(), 20, most, rounds.upcoming)
    for index in rounds(3):
        assert photos[index] == {"image_idx": index}
        assert len(photos._held) <= max(most, 1)
    assert len(photos) == 20 and list(photos) == [{"image_idx": i} for i in range(20)]
    assert photos[-1] == {"image_idx": 19}
    with pytest.raises(IndexError):
        photos[20]


def test_the_next_photos_are_read_before_they_are_asked_for():
    files = Files()
    unseen = list(range(9))
    photos = BoundedPhotos(files, 9, 3, lambda: unseen)
    _ = photos[unseen.pop(0)]
    assert files.has_read(1) and files.has_read(2)
    assert set(photos._held) == {0, 1, 2}
    _ = photos[unseen.pop(0)]
    assert files.has_read(3) and set(photos._held) == {1, 2, 3}


@pytest.mark.parametrize("room", [1, 10, 39])
def test_as_few_photos_are_read_again_as_there_is_no_room_for(room: int):
    """Each round needs those of the N that do not stay: N less the room, but for that of one photo
    and those that come next."""
    count, rounds, files = 40, 6, Files()
    order = Rounds(count)
    photos = BoundedPhotos(files, count, room, order.upcoming)
    for index in order(rounds):
        _ = photos[index]
    photos._pool.shutdown(wait=True)
    assert len(files.read) <= count + (rounds - 1) * (count - room + min(1 + AHEAD, room))
