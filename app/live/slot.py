"""A place for one item between two threads: the latest wins, what was not taken in time is dropped and counted."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Slot(Generic[T]):
    """Holds one item.

    Parameters
    ----------
    lossless : `put` waits until the last item was taken instead of replacing it.

    Attributes
    ----------
    dropped : number of items that were replaced before they were taken.
    closed : nothing more comes.
    """

    def __init__(self, *, lossless: bool = False) -> None:
        self.dropped = 0
        self.closed = False
        self._lossless = lossless
        self._item: T | None = None
        self._changed = threading.Condition()

    def put(self, item: T) -> None:
        """Offer an item; after `close` it is ignored."""
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: self._item is None or self.closed)
            if self.closed:
                return
            self.dropped += self._item is not None
            self._item = item
            self._changed.notify_all()

    def get(self, timeout: float | None = None) -> T | None:
        """Take the item, waiting for it; None when it is closed and empty, or `timeout` seconds have passed."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None or self.closed, timeout)
            item, self._item = self._item, None
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Nothing more comes; what lies there can still be taken."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
