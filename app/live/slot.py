"""A one-item slot between two threads: the latest item wins; items replaced before they are taken are counted."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestSlot(Generic[T]):
    """Holds at most one item.

    Parameters
    ----------
    lossless : `put` waits until the previous item has been taken instead of replacing it.

    Attributes
    ----------
    dropped : number of items that were replaced before they were taken.
    closed : no more items come.
    """

    def __init__(self, *, lossless: bool = False) -> None:
        self.dropped = 0
        self.closed = False
        self._lossless = lossless
        self._item: T | None = None
        self._changed = threading.Condition()

    def put(self, item: T) -> None:
        """Offer an item; ignored after `close`."""
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: self._item is None or self.closed)
            if self.closed:
                return
            self.dropped += self._item is not None
            self._item = item
            self._changed.notify_all()

    def get(self, timeout: float | None = None) -> T | None:
        """Wait for an item and take it; None when the slot is closed and empty, or after `timeout` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None or self.closed, timeout)
            item, self._item = self._item, None
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Accept no more items; the one in the slot can still be taken."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
