"""Settings that the user changes during a live run, by keys or on a page.  Safe to use from any thread."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import replace
from queue import SimpleQueue
from typing import Any, Literal

from guise.app.live.options import LiveSettings, Mode

Request = Literal["record", "snapshot", "enrol", "quit"]

ALPHA_STEP = 0.1
USUAL_SETTINGS = LiveSettings()


_SWITCHES = {
    "m": "mirror",
    "b": "side_by_side",
    "k": "mask",
    "l": "mesh",
    "f": "readout",
    "h": "help",
}
_MODES: dict[str, Mode] = {"s": "swap", "p": "puppet", "o": "off"}
_REQUESTS: dict[str, Request] = {
    "r": "record",
    "c": "snapshot",
    "e": "enrol",
    "q": "quit",
    "escape": "quit",
}
KEYS = {
    "1 to 9": "face",
    "up, down": "alpha",
    "s": "swap",
    "p": "puppet",
    "o": "off: face covered",
    "m": "mirror",
    "b": "side by side (shows the real face)",
    "k": "mask",
    "l": "mesh",
    "f": "readout",
    "r": "record",
    "c": "snapshot",
    "e": "enroll again",
    "h": "help",
    "q": "quit",
}


class Controls:
    """The current settings and the user's pending requests.

    Parameters
    ----------
    identities : number of donor faces to choose from.
    settings : initial settings.
    asks : numbers of the faces that are covered until the user agrees, as they may be the user's own.

    Attributes
    ----------
    requests : SimpleQueue of Request, oldest first.
    """

    def __init__(
        self, identities: int = 1, settings: LiveSettings = USUAL_SETTINGS, asks: Iterable[int] = ()
    ) -> None:
        self.requests: SimpleQueue[Request] = SimpleQueue()
        self._identities, self._settings = identities, settings
        self._asks, self._agreed = set(asks), set[int]()
        self._lock = threading.Lock()

    @property
    def settings(self) -> LiveSettings:
        """The current settings."""
        return self._settings

    @property
    def is_asking(self) -> bool:
        """Whether the chosen face is one that is covered until the user agrees."""
        return self.asks_for(self._settings.identity)

    def asks_for(self, face: int) -> bool:
        """Whether a face is covered until the user agrees."""
        return face in self._asks - self._agreed

    def ask_for(self, faces: Iterable[int]) -> None:
        """Cover these faces as well until the user agrees."""
        self._asks |= set(faces)

    def agree(self, face: int) -> None:
        """The user agrees to a face."""
        self._agreed.add(face)

    def change(self, **changes: Any) -> None:
        """Change settings by name; alpha is clipped to [0, 1], an unknown identity is ignored."""
        with self._lock:
            if not 0 <= changes.get("identity", 0) < self._identities:
                del changes["identity"]
            new = replace(self._settings, **changes)
            self._settings = replace(new, alpha=round(min(max(new.alpha, 0.0), 1.0), 3))

    def press(self, key: str) -> None:
        """Handle a key by its lower-case name; keys without a meaning are ignored."""
        now = self._settings
        if key.isdigit() and key != "0":
            face = int(key) - 1
            if face == now.identity and self.is_asking:
                self.agree(face)
            self.change(identity=face)
        elif key in ("up", "down"):
            self.change(alpha=now.alpha + (ALPHA_STEP if key == "up" else -ALPHA_STEP))
        elif key in _SWITCHES:
            self.change(**{_SWITCHES[key]: not getattr(now, _SWITCHES[key])})
        elif key in _MODES:
            self.change(mode=_MODES[key])
        elif key in _REQUESTS:
            self.requests.put(_REQUESTS[key])
