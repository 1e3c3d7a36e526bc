"""A short queue between two threads that either of them can end."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Channel(Generic[T]):
    """Holds at most `size` items.

    latest : `put` replaces the oldest item instead of waiting for room.

    Attributes
    ----------
    dropped : number of items that were replaced before they were taken.
    closed : no more items come.
    """

    def __init__(self, size: int = 1, *, latest: bool = False) -> None:
        self.dropped = 0
        self.closed = False
        self._size, self._latest = size, latest
        self._items: deque[T] = deque()
        self._changed = threading.Condition()

    def put(self, item: T) -> bool:
        """Offer an item; False when the channel is closed, which ignores it."""
        with self._changed:
            self._changed.wait_for(lambda: self._latest or len(self._items) < self._size or self.closed)
            if self.closed:
                return False
            if len(self._items) == self._size:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._changed.notify_all()
            return True

    def get(self, timeout: float | None = None) -> T | None:
        """Wait for an item and take it; None when the channel is closed and empty, or after `timeout` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self.closed, timeout)
            self._changed.notify_all()
            return self._items.popleft() if self._items else None

    def close(self, *, discard: bool = False) -> None:
        """Accept no more items; those that are in it can still be taken unless they are discarded."""
        with self._changed:
            self.closed = True
            if discard:
                self._items.clear()
            self._changed.notify_all()
