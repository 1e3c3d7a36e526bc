"""Where the landmarks of an enrolment come from; quick to import, as a swap whose person is kept needs no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from guise.common.arrays import F64
from guise.common.files import fitting_name

if TYPE_CHECKING:
    from guise.aam.landmarks import Landmarker

SIDECARS = (".landmarks.npz", ".npz", ".landmarks.json", ".json", ".pts")


@dataclass(frozen=True)
class LandmarkSource:
    """Where landmarks come from: files (one for each clip), a landmarker, or else files that lie beside the clips.

    A clip without a file beside it gets its landmarks from the built-in landmarker.

    points : (n, 81, 2) of all frames of each clip, NaN without a face, where they are known already.
    refine : whether detected landmarks are refined jointly over all frames.  By default only those of other landmarkers
        are, as refinement doesn't improve tracking with the built-in one.  Landmarks from files are trusted.
    """

    files: Sequence[Path] = ()
    landmarker: Landmarker | None = None
    refine: bool | None = None
    points: Sequence[F64] = ()

    def refines(self, clip: Path) -> bool:
        """Whether a clip's landmarks are detected and then refined."""
        if self.landmarker is None:
            return bool(self.refine) and not self.gives(clip)
        return self.landmarker.name != "builtin" if self.refine is None else self.refine

    def gives(self, clip: Path) -> bool:
        """Whether a clip's landmarks are given and not detected."""
        return bool(self.points or self.files) or (
            self.landmarker is None and landmark_file(clip) is not None
        )


def landmark_file(clip: Path) -> Path | None:
    """The landmark file that lies beside a clip under its name, if there is one."""
    for suffix in SIDECARS:
        beside = clip.with_name(fitting_name(clip.stem, suffix))
        if beside.is_file():
            return beside
    return None
