"""The sample clip that comes with Guise, among the clips of the studio."""

from __future__ import annotations

from pathlib import Path

from guise.app.studio.site import Studio
from guise.app.studio.store import Clip
from guise.common.files import write_whole
from guise.common.samples import samples_folder

NAME, FILE = "A sample clip", Path("p01", "talk2.mp4")


def sample_clip(studio: Studio) -> Clip:
    """The sample clip; it is kept once."""
    for clip in studio.store.clips():
        if clip.name == NAME:
            return clip
    clip = studio.store.add_clip(NAME, FILE.suffix)
    write_whole(clip.path, (samples_folder() / FILE).read_bytes())
    return clip
