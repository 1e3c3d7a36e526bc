"""NAME.tracks.json, in which a reviewer changes what is done with each track.

An edited file that is not understood is refused, never guessed at: a typo could leave a face visible.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.covers import REASONS, THING, CoverSpan
from guise.app.deidentify.options import DeidentifyError
from guise.app.deidentify.tracks import MarkedPlace, Track, split_tracks
from guise.app.swapping.policy import ACTIONS
from guise.common.files import write_whole

TRACKS_FORMAT = "guise-tracks"
TRACKS_VERSION = 1
_TOP = (
    "format", "version", "input", "fingerprint", "frames", "how_to_edit", "splits", "tracks", "covers", "boxes",
)  # fmt: skip
MAX_PIXELS = 1 << 20  # of a coordinate
EDITABLE = ("action", "donor", "name", "person")
HOW_TO_EDIT = (
    "A track is one face, tracked through the video; the sheet of pictures beside this file shows each. Change the "
    "actions here, then run the same command again with --resume instead of --review.",
    'action: "swap" shows another face, "cover" hides the face, "leave" leaves the face as it is, for all to see. '
    "A face can be swapped only where can_swap is true; reason says why Guise would not.",
    "person: tracks with the same number are the same person and get the same donor; it is the number of one of the "
    "tracks. Give two tracks one number when they are one person, or a track its own number when it is another person.",
    'donor: whose face is shown, for all tracks of the person; "" lets Guise choose.',
    "name: what you call the person, for your own use; it is in no report.",
    'splits: {"3": [120]} at the top divides track 3, the second part of which begins with frame 120; the parts then '
    "need entries of their own, which the studio writes.",
    'covers: action "cover" hides what is there; "leave" says that it is no face; "swap" that it is one, which is '
    "swapped if it can be followed and enrolled. Covers of a track follow the track's action.",
    'boxes: {"first": 120, "last": 180, "box": [40, 30, 90, 95], "action": "cover"} covers a face that was missed in '
    'the frames 120 to 180, and follows it from where it is in the frame "at", the first one unless you say so. '
    "The box, x0 y0 x1 y1 in pixels, goes from brows to chin. action is as in covers.",
    "Do not change anything else. Faces that are not in a track here are covered.",
)


def write_tracks(
    path: Path,
    tracks: Sequence[Track],
    *,
    input_name: str,
    fingerprint: str,
    frames: int,
    seconds: NDArray[np.float64],
    covers: Sequence[CoverSpan] = (),
    splits: Mapping[int, Sequence[int]] | None = None,
) -> None:
    """Write the tracks for a reviewer to edit.

    input_name, fingerprint : of the video.   frames : number of them.   seconds : (frames,) time of each.
    covers : what would be covered.   splits : which tracks the user has split, see `split_tracks`.
    """
    splits = splits or {}
    head = {
        "format": TRACKS_FORMAT,
        "version": TRACKS_VERSION,
        "input": input_name,
        "fingerprint": fingerprint,
        "frames": frames,
        "how_to_edit": HOW_TO_EDIT,
        **({"splits": {str(number): list(frames) for number, frames in splits.items()}} if splits else {}),
    }
    parts = split_tracks(tracks, splits)
    rows = [_row(track) | {"seconds": _times(track, seconds)} for track in parts]
    shown = [_cover_row(one) | {"seconds": _times(one, seconds)} for one in covers]
    text = (
        json.dumps(head, indent=2, ensure_ascii=False)[:-2] + ',\n  "tracks": [' + _laid_out(rows)
        + '],\n  "covers": [' + _laid_out(shown) + '],\n  "boxes": []\n}\n'
    )  # fmt: skip
    # A name that isn't valid Unicode holds lone surrogates, which only JSON escapes can represent.
    write_whole(path, text.encode("utf-8", "backslashreplace"))


def read_tracks(path: Path, tracks: Sequence[Track], fingerprint: str) -> tuple[Track, ...]:
    """The tracks with what the user changed in an edited file.

    Raises DeidentifyError when it is not the file of these tracks of this video with sensible edits.
    """
    value = _loaded(path)
    rows = _rows(path, value, fingerprint)
    tracks = split_tracks(tracks, _splits(path, value, tracks))
    known = {track.number: track for track in tracks}
    edited: dict[int, Track] = {}
    for place, row in enumerate(rows, 1):
        number = row.get("track") if isinstance(row, dict) else None
        if type(number) is not int or number not in known:
            raise DeidentifyError(
                f"{path}: entry {place}: track is {_quoted(number)}, which this video does not have"
            )
        if number in edited:
            raise DeidentifyError(f"{path}: track {number} appears twice: delete one of the two")
        edited[number] = _edited(path, known[number], row, known)
    missing = [number for number in known if number not in edited]
    if missing:
        raise DeidentifyError(
            f"{path}: track {missing[0]} is missing: put it back; to hide the face use action cover"
        )
    return _agreed(path, tracks, [edited[track.number] for track in tracks])


def read_places(path: Path, covers: Sequence[CoverSpan], frames: int, fingerprint: str) -> list[MarkedPlace]:
    """What the user says of covers and of boxes in an edited file.

    covers : of faces that are not tracked.   frames : number of them.
    Raises DeidentifyError as `read_tracks` does.
    """
    value = _loaded(path)
    _rows(path, value, fingerprint)
    if more := value.keys() - _TOP:
        raise DeidentifyError(
            f"{path}: there is no field {_quoted(min(more))} at the top: {', '.join(_TOP)} are"
        )
    lists = [value.get(name, []) for name in ("covers", "boxes")]
    for name, rows in zip(("covers", "boxes"), lists, strict=True):
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise DeidentifyError(f"{path}: {name} must be a list of objects, got {_quoted(rows)}")
    known = {one.number: one for one in covers}
    numbers = [_quoted(row.get("number")) for row in lists[0]]
    if twice := [number for number in numbers if numbers.count(number) > 1]:
        raise DeidentifyError(f"{path}: cover {twice[0]} appears twice: delete one of the two")
    proposed = {_quoted(one.number): _proposed(one) for one in covers}
    changed = [
        row
        for row, n in zip(lists[0], numbers, strict=True)
        if row.get("action", "cover") != proposed.get(n, "cover")
    ]
    places = [_of_cover(path, row, known) for row in changed]
    return places + [_drawn(f"{path}: box {n}", row, frames) for n, row in enumerate(lists[1], 1)]


def _of_cover(path: Path, row: dict[str, Any], known: Mapping[int, CoverSpan]) -> MarkedPlace:
    """What the user says of a cover."""
    number: Any = row.get("number")
    action = row["action"]
    one = known.get(number) if type(number) is int else None
    if one is None:
        raise DeidentifyError(
            f"{path}: cover {_quoted(number)} can't get an action: only those of faces without a track can; "
            "draw a box for others"
        )
    if action not in ACTIONS:
        raise DeidentifyError(
            f"{path}: cover {number}: action must be one of {', '.join(ACTIONS)}, got {_quoted(action)}"
        )
    fixed = _cover_row(one)
    for key in fixed.keys() - {"action"}:
        if row.get(key) != json.loads(json.dumps(fixed[key])):
            raise DeidentifyError(
                f"{path}: cover {number}: {key} must not be edited: put it back (it was {_quoted(fixed[key])})"
            )
    return MarkedPlace(one.first, one.last, one.shown, one.box, action, number)


def _drawn(where: str, row: dict[str, Any], frames: int) -> MarkedPlace:
    """A box that the user has drawn, checked."""
    if more := row.keys() - {"first", "last", "at", "box", "action"}:
        raise DeidentifyError(
            f"{where}: there is no field {_quoted(min(more))}; a box has first, last, at, box, action"
        )
    first: Any = row.get("first")
    last: Any = row.get("last")
    at, box, action = row.get("at", first), row.get("box") or [], row.get("action", "cover")
    if any(type(one) is not int for one in (first, last, at)) or not 0 <= first <= at <= last < frames:
        raise DeidentifyError(
            f"{where}: first, at and last must be frames from 0 to {frames - 1}, in this order, "
            f"got {_quoted([first, at, last])}"
        )
    if not _is_box(box):
        raise DeidentifyError(
            f"{where}: box must be [x0, y0, x1, y1], left to right and down, got {_quoted(box)}"
        )
    if action not in ACTIONS:
        raise DeidentifyError(f"{where}: action must be one of {', '.join(ACTIONS)}, got {_quoted(action)}")
    return MarkedPlace(first, last, at, (box[0], box[1], box[2], box[3]), action)


def _is_box(box: Any) -> bool:
    if not isinstance(box, list) or len(box) != 4 or any(type(v) not in (int, float) for v in box):
        return False
    finite = all(abs(v) < MAX_PIXELS for v in box)
    return finite and bool(box[0] + 1 <= box[2] and box[1] + 1 <= box[3])


def _cover_row(one: CoverSpan) -> dict[str, Any]:
    """A cover; only that of a face without a track has an action of its own."""
    return vars(one) | ({} if one.track else {"action": _proposed(one)})


def _proposed(one: CoverSpan | None) -> str:
    """What happens to it unless the user says otherwise."""
    return "leave" if one is not None and one.reason == REASONS[THING] else "cover"


def _splits(path: Path, value: dict[str, Any], tracks: Sequence[Track]) -> dict[int, list[int]]:
    """Where the file splits tracks, checked."""
    given, known = value.get("splits", {}), {str(track.number): track for track in tracks}
    if not isinstance(given, dict):
        raise DeidentifyError(f'{path}: splits must be like {{"1": [120]}}, got {_quoted(given)}')
    for number, frames in given.items():
        track = known.get(number)
        if track is None:
            raise DeidentifyError(f"{path}: splits: there is no track {_quoted(number)} to split")
        whole = isinstance(frames, list) and all(type(frame) is int for frame in frames)
        if not whole or any(a >= b for a, b in pairwise([track.first, *frames, track.last + 1])):
            raise DeidentifyError(
                f"{path}: splits: track {number} can be split at ascending frames from {track.first + 1} to "
                f"{track.last}, got {_quoted(frames)}"
            )
    return {int(number): frames for number, frames in given.items()}


def _row(track: Track) -> dict[str, Any]:
    return {
        "track": track.number,
        "person": track.person,
        "name": track.name,
        "action": track.action,
        "donor": track.donor,
        "can_swap": _can_swap(track),
        "proposed": track.proposed,
        "reason": track.reason,
        "frames": [track.first, track.last],
        "seen": track.seen,
        "width": round(track.width, 1),
        "confidence": [round(c, 2) for c in track.confidence],
        **({"part_of": track.part_of} if track.part_of else {}),
    }


def _can_swap(track: Track) -> bool:
    return track.can_swap or track.proposed == "swap"


def _times(track: Track | CoverSpan, seconds: NDArray[np.float64]) -> list[float]:
    return [round(float(seconds[frame]), 3) for frame in (track.first, track.last)]


def _laid_out(rows: Sequence[Mapping[str, Any]]) -> str:
    """The entries of a list, one value a line."""
    lines = (
        ",\n".join(f"      {json.dumps(k)}: {json.dumps(v, ensure_ascii=False)}" for k, v in row.items())
        for row in rows
    )
    return ",".join(f"\n    {{\n{text}\n    }}" for text in lines) + ("\n  " if rows else "")


def _loaded(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_once_each)
    except FileNotFoundError:
        raise DeidentifyError(f"{path} does not exist: --review writes one") from None
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise DeidentifyError(
            f"{path} isn't valid JSON at {where}: {error.msg}; look for a missing comma or quote"
        ) from None
    except UnicodeDecodeError:
        raise DeidentifyError(f"{path} isn't UTF-8 text: save it as UTF-8") from None
    except (ValueError, RecursionError) as error:
        raise DeidentifyError(f"{path} can't be read: {error}") from None


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object, unless a key appears twice, of which JSON would ignore the first."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        track = f" in track {found['track']}" if "track" in found else ""
        raise ValueError(f"{twice} appears twice{track}: delete one of the two")
    return found


def _rows(path: Path, value: Any, fingerprint: str) -> list[Any]:
    if (
        not isinstance(value, dict)
        or value.get("format") != TRACKS_FORMAT
        or not isinstance(value.get("tracks"), list)
    ):
        raise DeidentifyError(f"{path} isn't a file of tracks: --review writes one as NAME.tracks.json")
    if value.get("version") != TRACKS_VERSION:
        raise DeidentifyError(
            f"{path} has version {_quoted(value.get('version'))} of the format, and this Guise reads version "
            f"{TRACKS_VERSION}: write a new one with --review"
        )
    if value.get("fingerprint") != fingerprint:
        raise DeidentifyError(
            f"{path} was written for another video ({_quoted(value.get('input'))}), or this one has changed since: "
            "write a new one with --review"
        )
    return list(value["tracks"])


def _edited(path: Path, track: Track, row: dict[str, Any], known: Container[int]) -> Track:
    """A track with the user's values.   known : numbers of all tracks."""
    where, fixed = f"{path}: track {track.number}", _row(track)
    for key in row:
        if key not in fixed and key != "seconds":
            raise DeidentifyError(
                f"{where}: there is no field {_quoted(key)}; the fields to edit are {', '.join(EDITABLE)}"
            )
    for key, value in fixed.items():
        if key not in row:
            raise DeidentifyError(f"{where}: {key} is missing: put it back (it was {_quoted(value)})")
        if key not in EDITABLE and row[key] != value:
            raise DeidentifyError(
                f"{where}: {key} must not be edited: put it back (it was {_quoted(value)}); "
                f"the fields to edit are {', '.join(EDITABLE)}"
            )
    for key, fits, wanted in _WANTED:
        if not fits(row[key]):
            raise DeidentifyError(f"{where}: {key} must be {wanted}, got {_quoted(row[key])}")
    if row["person"] not in known:
        raise DeidentifyError(f"{where}: person must be the number of a track, got {row['person']}")
    if row["action"] == "swap" and not _can_swap(track):
        why = f" ({track.reason})" if track.reason else ""
        raise DeidentifyError(
            f"{where}: action is swap, but this face can't be swapped{why}: use cover or leave"
        )
    return replace(track, **{key: row[key] for key in EDITABLE})


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


_WANTED: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
    ("action", lambda v: v in ACTIONS, "one of " + ", ".join(ACTIONS)),
    ("person", lambda v: type(v) is int, "a whole number"),
    ("donor", _is_text, 'text in quotes, "" for any'),
    ("name", _is_text, 'text in quotes, "" for none'),
)


def _agreed(path: Path, before: Sequence[Track], after: Sequence[Track]) -> tuple[Track, ...]:
    """Tracks of one person with one donor and one name: the edited one, or that of the first track."""
    agreed = {}
    for person in {track.person for track in after}:
        own = [(old, new) for old, new in zip(before, after, strict=True) if new.person == person]
        agreed[person] = _common(path, "donor", own), _common(path, "name", own)
    return tuple(replace(t, donor=agreed[t.person][0], name=agreed[t.person][1]) for t in after)


def _common(path: Path, key: Literal["donor", "name"], own: Sequence[tuple[Track, Track]]) -> str:
    given = {getattr(new, key): new for old, new in own if getattr(new, key) != getattr(old, key)}
    if len(given) > 1:
        one, other = list(given.values())[:2]
        raise DeidentifyError(
            f"{path}: tracks {one.number} and {other.number} are person {one.person} but have {key} "
            f"{_quoted(getattr(one, key))} and {_quoted(getattr(other, key))}: give both the same, or another person"
        )
    return next(iter(given)) if given else str(getattr(own[0][1], key))


def _quoted(value: Any) -> str:
    """A value as it stands in the file, shortened."""
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
