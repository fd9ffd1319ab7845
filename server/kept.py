"""What was made last of something that does not change any more, so that it is made once."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Made = TypeVar("Made")


class Kept(Generic[Key, Made]):
    """The latest used ones, by a key that stands for what they are made of; for all threads."""

    def __init__(self, most: int):
        self._most, self._lock = most, Lock()
        self._made: OrderedDict[Key, Made] = OrderedDict()

    def kept(self, key: Key, make: Callable[[], Made]) -> Made:
        """The one of this key, made if it is not there."""
        with self._lock:
            if key in self._made:
                self._made.move_to_end(key)
                return self._made[key]
        made = make()
        with self._lock:
            self._made[key] = made
            if len(self._made) > self._most:
                self._made.popitem(last=False)
        return made
