"""Guise: real-time face swap and video de-identification on an ordinary CPU, with Active Appearance Models.

    import guise

    person = guise.enroll("clip.mp4")
    guise.swap_file("video.mp4", person, "swapped.mp4")

Pictures are RGB uint8 (h, w, 3); points are pixels, x right, y down, pixel centres at integers.  A user's mistake is a
`GuiseError` whose text is one sentence.  Importing this module loads nothing else: each name loads what it needs when
it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from guise.aam.landmarks import Face
    from guise.aam.model import Identity
    from guise.api import (
        Swapper,
        deidentify,
        enroll,
        landmarks,
        load,
        measure,
        swap_file,
        transfer_mesh,
        transfer_photo,
    )
    from guise.common.errors import GuiseError

    __version__: str

__all__ = [
    "Face",
    "GuiseError",
    "Identity",
    "Swapper",
    "deidentify",
    "enroll",
    "landmarks",
    "load",
    "measure",
    "swap_file",
    "transfer_mesh",
    "transfer_photo",
]

_FORMER = {"enrol": "enroll"}  # names of 0.2, which go with 0.3
_HOMES = {"Face": "guise.aam.landmarks", "GuiseError": "guise.common.errors", "Identity": "guise.aam.model"}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from guise.common.version import VERSION

        return VERSION
    if name in _FORMER:
        import warnings

        warnings.warn(f"guise.{name} is now guise.{_FORMER[name]}", DeprecationWarning, stacklevel=2)
        return __getattr__(_FORMER[name])
    if name not in __all__:
        raise AttributeError(f"module 'guise' has no attribute {name!r}")
    value = getattr(import_module(_HOMES.get(name, "guise.api")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
