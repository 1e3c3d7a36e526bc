"""The jobs behind the page De-identify: the review of a clip, and its rendering with the user's choices.

A review's folder holds OUTPUT.work, what was found; out.tracks.json, the proposal; and TRACK.NUMBER.jpg, pictures of
the tracks.  A rendering works on a copy of what was found, so that a clip can be rendered again with other choices.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from guise.app.deidentify.covers import FOUND, REASONS, CoverSpan
from guise.app.deidentify.options import Audio, DeidentifyOptions, Region
from guise.app.deidentify.report.quality import track_quality
from guise.app.deidentify.report.report import outcome, verdict
from guise.app.deidentify.run.job import deidentify_file, draw_frames, replanned, work_folder
from guise.app.deidentify.run.planning import covers_without_track
from guise.app.deidentify.run.registry import open_engine
from guise.app.deidentify.run.results import cover_pictures, pictures, write_review
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.work import MANIFEST, WorkFolder
from guise.app.deidentify.tracks import Track
from guise.app.media.pictures import save_picture
from guise.app.studio.option_form import EncodingOptions, taken
from guise.app.studio.pictures import fitted_to, frames_until, output_suffix
from guise.app.studio.store import StudioError
from guise.app.swapping.policy import Action
from guise.common.arrays import U8
from guise.common.files import write_whole
from guise.common.progress import Progress, mute

STEM = "out"
TRACKS = f"{STEM}.tracks.json"
CHOICES = "choices.json"
SHARED = ("cover", "cover_strength", "alpha", "audio", "region")  # options that are chosen on the page
REPORTS = (f"{STEM}.report.html", f"{STEM}.report.json")


@dataclass
class DeidentifyChoices:
    """The user's choices for a clip.

    Parameters
    ----------
    actions : by track.   donors : by person; "" lets Guise choose.  Keys are numbers as text, as in JSON.
    people : by track, whose it is, where the user has changed that.   names : by person.
    covers : by cover of a face without a track, what is there.   boxes : that the user drew, as in the file TRACKS.
    cover, cover_strength, alpha, audio, region : as in `guise.app.deidentify.options.Options`.
    more : other options, by their names on the command line.
    """

    actions: dict[str, Action]
    donors: dict[str, str]
    cover: str = DeidentifyOptions().cover
    cover_strength: int = DeidentifyOptions().cover_strength
    alpha: float = DeidentifyOptions().alpha
    audio: Audio = DeidentifyOptions().audio
    region: Region = DeidentifyOptions().region
    people: dict[str, int] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    covers: dict[str, Action] = field(default_factory=dict)
    boxes: list[dict[str, Any]] = field(default_factory=list)
    more: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def proposed(cls, tracks: list[dict[str, Any]]) -> DeidentifyChoices:
        """The choices that Guise proposes.   tracks : from the file TRACKS."""
        actions = {str(track["track"]): track["action"] for track in tracks}
        return cls(actions, {str(track["person"]): track["donor"] for track in tracks})

    @classmethod
    def load(cls, folder: Path) -> DeidentifyChoices:
        """The choices that were saved in a review's folder, or the proposed ones."""
        path = folder / CHOICES
        if path.exists():
            return cls(**json.loads(path.read_text(encoding="utf-8")))
        return cls.proposed(read_tracks(folder)["tracks"])

    def save(self, folder: Path) -> None:
        """Save the choices in a review's folder."""
        write_whole(folder / CHOICES, json.dumps(asdict(self)))

    def person_of(self, track: dict[str, Any]) -> int:
        """Whose a track of the file TRACKS is."""
        return self.people.get(str(track["track"]), int(track["person"]))

    def options(self) -> DeidentifyOptions:
        """As `deidentify_file` takes them."""
        return replace(options_from(self.more), **{name: getattr(self, name) for name in SHARED})


def options_from(values: Mapping[str, Any]) -> DeidentifyOptions:
    """Options by their names on the command line."""
    return replace(taken(DeidentifyOptions, values), encode=taken(EncodingOptions, values).options())


def write_edited(folder: Path, choices: DeidentifyChoices, tracks: Path) -> None:
    """Write the choices to the file of tracks that the command line reads."""
    write_whole(tracks, _edited(folder, choices))
    tracks.chmod(0o600)


def read_tracks(folder: Path) -> dict[str, Any]:
    """What was proposed for a video, from a review's folder."""
    value: dict[str, Any] = json.loads((folder / TRACKS).read_text(encoding="utf-8"))
    return value


def review(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Find the faces of a clip and propose what to do with them.

    about : source, the clip's path; options, by their names on the command line; reviewed, the output of which a
        review was made on the command line, if one was.
    Returns the output's file name, the time of the last frame, the number of frames, and the frames of the pictures of
    each track.
    """
    source = Path(about["source"])
    given = about.get("options", {})
    options = options_from(given)
    output = folder / (STEM + output_suffix(source, options.encode.encoder))
    reviewed = about.get("reviewed")
    if reviewed:
        options = _take_over(Path(reviewed), output)
    with open_engine("local") as engine:
        deidentify_file(
            source, output, options, engine, resume=bool(reviewed), review=True, progress=progress, say=mute
        )
    chosen = {name: getattr(options, name) for name in SHARED}
    replace(DeidentifyChoices.load(folder), more=given, **chosen).save(folder)
    case = Case(WorkFolder(work_folder(output)))
    save_covers(case, covers_without_track(case), folder)
    shown = pictures(case, "pictures")
    for track, some in shown.items():
        for place, picture in enumerate(some):
            save_picture(folder / thumbnail(track, place), picture)
    frames = {track.number: list(track.shown) for track in case.linked}
    counts = {str(track): frames[track][: len(some)] for track, some in shown.items()}
    return {
        "output": output.name, "seconds": float(case.times[-1]), "frames": case.scan.frames, "pictures": counts,
    }  # fmt: skip


def _take_over(reviewed: Path, output: Path) -> DeidentifyOptions:
    """Copy what a review on the command line has found; its options."""
    if not work_folder(reviewed).exists():
        raise StudioError(f"{work_folder(reviewed)} is gone: run guise deidentify --review again")
    shutil.copytree(work_folder(reviewed), work_folder(output))
    work = WorkFolder(work_folder(output))
    manifest = work.load_json(MANIFEST)
    work.save_json(MANIFEST, manifest | {"output": output.name})
    return DeidentifyOptions(**{name: manifest["options"][name] for name in SHARED})


def save_covers(case: Case, covers: Sequence[CoverSpan], folder: Path) -> None:
    """Pictures of what some covers hide."""
    for cover, picture in cover_pictures(case, covers).items():
        save_picture(folder / cover_picture(cover.number), picture)


def cover_picture(number: int) -> str:
    """File name of the picture of what a cover hides."""
    return f"cover.{number}.jpg"


def render(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Render a reviewed clip.

    about : source and name as for the review; found, its folder; output, its file name; choices, see
        `DeidentifyChoices`.
    Returns outcome, sentence, counts and problems of the report, which tracks are not swapped well, and the covers of
    what the audit found.
    """
    source, output, before = Path(about["source"]), folder / about["output"], Path(about["found"])
    choices = DeidentifyChoices(**about["choices"])
    if not before.exists():
        raise StudioError(f"the review of {about['name']} was deleted: upload the video again")
    shutil.copytree(work_folder(before / output.name), work_folder(output))
    write_whole(folder / TRACKS, _edited(before, choices))
    names = about["name"] + source.suffix, download_name(about["name"], output.name)
    with open_engine("local") as engine:
        report = deidentify_file(
            source, output, choices.options(), engine, resume=True, names=names, progress=progress, say=mute
        )
    assert report is not None
    found = [one for one in report.covers if one.reason == REASONS[FOUND]]
    save_covers(Case(WorkFolder(work_folder(before / output.name))), found, folder)
    times = [[float(report.seconds[frame]) for frame in (one.first, one.last)] for one in found]
    return {
        "outcome": outcome(report), "sentence": verdict(report), "counts": report.counts,
        "problems": list(report.problems), "doubts": doubts(report.tracks),
        "covers": [vars(one) | {"seconds": both} for one, both in zip(found, times, strict=True)],
    }  # fmt: skip


def doubts(tracks: Sequence[Track]) -> list[str]:
    """A sentence for each track that is swapped and poor."""
    judged = [(t, track_quality(t.width, t.confidence)) for t in tracks if t.action == "swap"]
    return [
        f"Look at track {track.number}: {quality.reason}."
        for track, quality in judged
        if quality.grade == "poor"
    ]


def split(folder: Path, output: str, choices: DeidentifyChoices, track: int, frame: int) -> DeidentifyChoices:
    """Split a track in a review's folder, so that a part of it begins with a frame; the choices for the parts."""
    before = read_tracks(folder)
    row = next(row for row in before["tracks"] if row["track"] == track)
    if not row["frames"][0] < frame <= row["frames"][1]:
        raise StudioError(
            f"frame {frame} is not within track {track}: move the slider Frame to where its second part begins"
        )
    splits = {int(number): frames for number, frames in before.get("splits", {}).items()}
    splits[_origin(row)] = sorted([*splits.get(_origin(row), []), frame])
    write_review(Case(WorkFolder(work_folder(folder / output))), folder / output, splits)
    after = _carried(choices, before["tracks"], read_tracks(folder)["tracks"])
    after.save(folder)
    return after


def _origin(row: dict[str, Any]) -> int:
    return int(row.get("part_of", row["track"]))


def _holds(row: dict[str, Any], part: dict[str, Any]) -> bool:
    return _origin(row) == _origin(part) and row["frames"][0] <= part["frames"][0] <= row["frames"][1]


def _carried(
    choices: DeidentifyChoices, old: list[dict[str, Any]], new: list[dict[str, Any]]
) -> DeidentifyChoices:
    """The choices for tracks of which one was split; a new part is a person of its own."""
    whole = {row["track"]: next(one for one in old if _holds(one, row)) for row in new}
    begins = {row["track"] for row in new if row["frames"][0] == whole[row["track"]]["frames"][0]}
    number = {whole[n]["track"]: n for n in begins}
    carried = replace(choices, actions={}, donors={}, names={}, people={})
    for n, before in whole.items():
        person = choices.person_of(before)
        mine = number[person] if n in begins else n
        carried.actions[str(n)], carried.people[str(n)] = choices.actions[str(before["track"])], mine
        carried.donors[str(mine)] = choices.donors.get(str(person), "") if n in begins else ""
        carried.names[str(mine)] = choices.names.get(str(person), "") if n in begins else ""
    return carried


def preview(
    source: Path, found: Path, choices: DeidentifyChoices, output: str, frame: int, width: int
) -> tuple[U8, U8]:
    """A frame before and after, RGB (h, w, 3).   found : folder of the review.   width : pixels, at most."""
    trial, tracks = found / "preview.work", found / "preview.tracks.json"
    if not trial.exists():
        shutil.copytree(work_folder(found / output), trial, copy_function=os.link)  # nothing in it changes
    write_whole(tracks, _edited(found, choices))
    case = replanned(trial, tracks, choices.options())
    some = frames_until(source, case.scan, frame, case.options.read)
    before = fitted_to(some[-1].rgb(), width)
    draw_frames(case, some)
    return before, fitted_to(some[-1].rgb(), width)


def thumbnail(track: int, place: int) -> str:
    """File name of a picture of a track; places count from 0."""
    return f"{track}.{place}.jpg"


def download_name(clip: str, file: str) -> str:
    """The name under which a user downloads a file of a rendering.

    >>> download_name("party", "out.report.json")
    'party_deidentified.report.json'
    """
    return f"{clip}_deidentified{file.removeprefix(STEM)}"


def _edited(review: Path, choices: DeidentifyChoices) -> str:
    """The track file's text with the user's choices."""
    value = read_tracks(review)
    for track in value["tracks"]:
        person = choices.person_of(track)
        donor, name = choices.donors.get(str(person), ""), choices.names.get(str(person), "")
        track |= {
            "action": choices.actions[str(track["track"])],
            "donor": donor,
            "person": person,
            "name": name,
        }
    for cover in value.get("covers", []):
        if str(cover["number"]) in choices.covers:
            cover["action"] = choices.covers[str(cover["number"])]
    return json.dumps(value | {"boxes": choices.boxes})
