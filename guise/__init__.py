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
    from guise.api.faces import (
        delete_people,
        enroll,
        find_people,
        gallery,
        info,
        load,
        people,
        rename_person,
    )
    from guise.api.heads import (
        mesh_landmarks,
        preview_mesh,
        register_mesh,
        transfer_mesh,
        transfer_rig,
        transfer_sequence,
    )
    from guise.api.hiding import Hidden, deidentify, measure, read_report, read_tracks
    from guise.api.live import LiveFrame, LiveSession
    from guise.api.options import preset
    from guise.api.photos import animate_photo, transfer_photo
    from guise.api.points import VideoFace, VideoLandmarks, landmarks, landmarks_file
    from guise.api.rigs import rig_from_video, rig_live
    from guise.api.tools import bench, demo, doctor, studio
    from guise.api.videos import Swapper, puppet_file, swap_file, swap_photo
    from guise.api.vocabulary import Cancelled
    from guise.common.errors import GuiseError

    __version__: str

__all__ = [
    "Cancelled",
    "Face",
    "GuiseError",
    "Hidden",
    "Identity",
    "LiveFrame",
    "LiveSession",
    "Swapper",
    "VideoFace",
    "VideoLandmarks",
    "animate_photo",
    "bench",
    "deidentify",
    "delete_people",
    "demo",
    "doctor",
    "enroll",
    "find_people",
    "gallery",
    "info",
    "landmarks",
    "landmarks_file",
    "load",
    "measure",
    "mesh_landmarks",
    "people",
    "preset",
    "preview_mesh",
    "puppet_file",
    "read_report",
    "read_tracks",
    "register_mesh",
    "rename_person",
    "rig_from_video",
    "rig_live",
    "studio",
    "swap_file",
    "swap_photo",
    "transfer_mesh",
    "transfer_photo",
    "transfer_rig",
    "transfer_sequence",
]

_FORMER = {"enrol": "enroll"}  # names of 0.2, which go with 0.3
_HOMES = {
    "guise.aam.landmarks": ("Face",),
    "guise.aam.model": ("Identity",),
    "guise.common.errors": ("GuiseError",),
    "guise.api.faces": (
        "delete_people",
        "enroll",
        "find_people",
        "gallery",
        "info",
        "load",
        "people",
        "rename_person",
    ),
    "guise.api.heads": (
        "mesh_landmarks",
        "preview_mesh",
        "register_mesh",
        "transfer_mesh",
        "transfer_rig",
        "transfer_sequence",
    ),
    "guise.api.hiding": (
        "Hidden",
        "deidentify",
        "measure",
        "read_report",
        "read_tracks",
    ),
    "guise.api.live": ("LiveFrame", "LiveSession"),
    "guise.api.options": ("preset",),
    "guise.api.photos": (
        "animate_photo",
        "transfer_photo",
    ),
    "guise.api.points": (
        "VideoFace",
        "VideoLandmarks",
        "landmarks",
        "landmarks_file",
    ),
    "guise.api.rigs": ("rig_from_video", "rig_live"),
    "guise.api.tools": (
        "bench",
        "demo",
        "doctor",
        "studio",
    ),
    "guise.api.videos": (
        "Swapper",
        "puppet_file",
        "swap_file",
        "swap_photo",
    ),
    "guise.api.vocabulary": ("Cancelled",),
}


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
    home = next(module for module, names in _HOMES.items() if name in names)
    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
