"""A file that is being de-identified: what its work folder says of it.

Results in the folder: manifest.json, scan.json, detect.K.npz, link.json, person.P.guise or person.P.json (why there is
none), region.json, gaps.K.npz, fit.K.npz, things.json, places.json, added.json, added.K.npz, tracks.json, plan.npz,
trial.K.json, render.K.packets, output.K.npz, drawn.K.npz and render.K.json, for segments K and persons P.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.model import Identity
from guise.aam.tracker import Tracker
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.stages.fit import Fits
from guise.app.deidentify.stages.gaps import Gaps, unpacked
from guise.app.deidentify.stages.work import MANIFEST, WorkFolder
from guise.app.deidentify.tracks import MarkedPlace, Track
from guise.app.media import Frame, MediaInput, open_input
from guise.app.media.problems import ProblemLog
from guise.app.media.segments import KeptFrames, Scan, read_frames
from guise.app.media.time_range import TimeRange
from guise.app.people.faces import SegmentFaces
from guise.app.swapping.donors import heads_for
from guise.common.memory import free_bytes

KEPT_BYTES = 200 << 20  # at most, of the frames of a short file
KEPT_SHARE = 0.25  # at most, of the memory that is free
KEPT = KeptFrames(lambda: min(KEPT_BYTES, int(KEPT_SHARE * free_bytes())))
PLACES, ADDED = "places.json", "added.json"
LEAD_FRAMES = 16  # by which a rendered segment begins after its keyframe, for the light to be measured over


@dataclass(frozen=True)
class LinkedTrack:
    """A track whose person is not known yet.

    Parameters
    ----------
    number : from 1.   pieces : (segment, number of the tracklet) in the order of time.
    first, last, seen, width : as for `guise.app.deidentify.tracks.Track`.
    sure : number of frames in which the landmarks are confident.
    shown : frames in which its landmarks are most confident, for pictures of it.
    """

    number: int
    pieces: tuple[tuple[int, int], ...]
    first: int
    last: int
    seen: int
    width: float
    sure: int
    shown: tuple[int, ...]


class Case:
    """Reads the results so far; none of them changes once it is there.

    work : the work folder.
    """

    def __init__(self, work: WorkFolder) -> None:
        self.work = work
        self.manifest: dict[str, Any] = work.load_json(MANIFEST)
        self.input = Path(self.manifest["input"])
        self.options = DeidentifyOptions.from_json(self.manifest["options"])
        self._trackers: dict[int, Tracker] = {}  # by person

    @cached_property
    def scan(self) -> Scan:
        """The frames and segments."""
        return Scan.from_json(self.work.load_json("scan.json"))

    def frames(self, first: int, last: int, problems: ProblemLog | None = None) -> Iterator[Frame]:
        """The frames [first, last), see `read_frames`; a short file is decoded once for all stages of a process."""
        return read_frames(
            self.input, self.scan, first, last, problems=problems, kept=KEPT, part=self.options.read
        )

    def open_input(self) -> MediaInput:
        """The input, or the part of it that is kept."""
        return open_input(self.input, part=self.options.read)

    @cached_property
    def worked_on(self) -> NDArray[np.bool_]:
        """(frames,) whether faces are hidden in a frame; in the others they stay, as the user said."""
        part, pts = self.options.drawn or TimeRange(), self.scan.pts.tolist()
        return np.array([part.holds((one - pts[0]) * self.scan.time_base) for one in pts], bool)

    @cached_property
    def rate(self) -> float:
        """Frames a second, the usual one, for what is measured in seconds; the only one of a photo lasts as long."""
        steps = np.diff(self.scan.pts)
        return float(1 / (np.median(steps) * self.scan.time_base)) if len(steps) else 1.0

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """(frames,) time of each frame after the first, seconds."""
        return np.asarray((self.scan.pts - self.scan.pts[:1]) * float(self.scan.time_base), np.float64)

    def found(self, segment: int, *, points: bool = True) -> SegmentFaces:
        """The faces of a segment; without their points, which are most of it, (0, 81, 2) stands for them."""
        but = "" if points else "points"
        arrays = self.work.load_arrays(f"detect.{segment}.npz", but)
        if self.work.has(ADDED) and self.work.has(added := f"added.{segment}.npz"):
            more = self.work.load_arrays(added, but)
            arrays |= {name: np.concatenate([arrays[name], values]) for name, values in more.items()}
        return SegmentFaces(**{"points": np.zeros((0, 81, 2), np.float32), **arrays})

    def fits(self, segment: int) -> Fits:
        """The placed faces of a segment."""
        return Fits(**self.work.load_arrays(f"fit.{segment}.npz"))

    def gaps(self, segment: int) -> Gaps:
        """What the heads of a segment leave; nothing unless they are to be replaced."""
        name = f"gaps.{segment}.npz"
        return unpacked(self.work.load_arrays(name)) if self.work.has(name) else {}

    @cached_property
    def cuts(self) -> list[int]:
        """First frames of new shots."""
        return [int(c) for c in self.work.load_json("link.json")["cuts"]]

    @cached_property
    def linked(self) -> list[LinkedTrack]:
        """The tracks as they were linked, then those of faces that the user has pointed at."""
        return [
            LinkedTrack(
                **entry | {"pieces": tuple(map(tuple, entry["pieces"])), "shown": tuple(entry["shown"])}
            )
            for entry in self.work.load_json("link.json")["tracks"] + self.added["tracks"]
        ]

    @cached_property
    def added(self) -> dict[str, Any]:
        """Tracks of faces that the user has pointed at, as linked ones, and for which of the places each is."""
        empty: dict[str, Any] = {"tracks": [], "places": []}
        return dict(self.work.load_json(ADDED)) if self.work.has(ADDED) else empty

    @cached_property
    def places(self) -> list[MarkedPlace]:
        """What the user says of places."""
        known = self.work.load_json(PLACES) if self.work.has(PLACES) else []
        return [MarkedPlace(**entry | {"box": tuple(entry["box"])}) for entry in known]

    def has_enrolled(self, track: int) -> bool:
        """Whether somebody was enrolled from a track."""
        return self.work.has(f"person.{track}.guise")

    def enrolled(self, track: int) -> Identity:
        """The model that was enrolled from a track, read anew."""
        return Identity.load(self.work.path(f"person.{track}.guise"))

    @cached_property
    def people(self) -> dict[int, int]:
        """By track, the person: the number of the track from which they were enrolled, or its own."""
        return {int(k): int(v) for k, v in self.work.load_json("people.json").items()}

    def has_model(self, track: int) -> bool:
        """Whether there is a model of a track's person."""
        return self.has_enrolled(self.people[track])

    def model_of(self, track: int) -> Identity:
        """The model of a track's person, a dozen megabytes, read anew."""
        return self.enrolled(self.people[track])

    def tracker_of(self, track: int) -> Tracker:
        """What tells how well a face is that of a track's person."""
        person = self.people[track]
        if person not in self._trackers:
            self._trackers[person] = self.enrolled(person).tracker
        return self._trackers[person]

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """The tracks with what is to be done."""
        return tuple(track_from(entry) for entry in self.work.load_json("tracks.json"))

    @cached_property
    def heads(self) -> dict[int, str]:
        """By person, whose head is drawn about the face; people of a key file keep theirs in all videos."""
        faces = {track.person: track.donor for track in self.tracks if track.donor}
        options, salt = self.options, "" if self.options.keyfile else str(self.manifest["name"])
        return heads_for(faces, options.donor, own=options.gallery, seed=options.seed, salt=salt)

    @cached_property
    def plan(self) -> dict[str, NDArray[Any]]:
        """What is to happen to each face, in the columns of `guise.app.deidentify.covers`."""
        return self.work.load_arrays("plan.npz")

    def span(self, segment: int) -> tuple[int, int]:
        """The frames [first, last) of a rendered segment."""
        pieces = self.scan.segments
        first = pieces[segment].first + (LEAD_FRAMES if segment else 0)
        last = pieces[segment].end + (LEAD_FRAMES if segment + 1 < len(pieces) else 0)
        return first, last


def track_from(entry: dict[str, Any]) -> Track:
    """The track that `track_json` gave."""
    return Track(**entry | {"confidence": tuple(entry["confidence"])})


def track_json(track: Track) -> dict[str, Any]:
    """A track as JSON holds it."""
    return asdict(track)
