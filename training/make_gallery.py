"""Enrols the donors that ship with Guise (app/gallery) from the clips of rendered people who do not exist.

    python -m training.make_gallery --people DIR

DIR holds a folder p01, p02 .. for each, with talk.mp4 and talk2.mp4 (CC0, made by the same program as sample_videos).
The landmarks are found by the built-in landmarker, as those of the people in videos are, so that both mean the same
places of a face.  A model keeps few modes: a swap needs the donor's own ways to move only as far as they differ from
everybody's.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from aam.landmarks import open_landmarker
from aam.model import Identity
from aam.training import TrainingOptions
from app.enrol import LandmarkSource, enrol
from app.version import version

GALLERY = Path(__file__).parents[1] / "app" / "gallery"
OPTIONS = TrainingOptions(max_modes=12)
TAKES = ("talk.mp4", "talk2.mp4")


def donor(folder: Path) -> Identity:
    """The model of a rendered person."""
    landmarks = LandmarkSource(landmarker=open_landmarker("builtin"))
    person = enrol([folder / take for take in TAKES], landmarks, name=folder.name, options=OPTIONS)
    return replace(person, facts={**person.facts, "guise": version(), "licence": "CC0-1.0"})


def main() -> None:
    """Write the gallery."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--people", type=Path, required=True, help="folder of the people's clips")
    GALLERY.mkdir(exist_ok=True)
    for folder in sorted(parser.parse_args().people.glob("p0*")):
        size = donor(folder).save(GALLERY / f"{folder.name}.guise")
        print(folder.name, f"{size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
