"""The jobs behind the page De-identify: the review of a clip, and its rendering with the user's choices.

A review's folder holds OUTPUT.work, what was found; out.tracks.json, the proposal; and TRACK.NUMBER.jpg, pictures of
the tracks.  A rendering works on a copy of what was found, so that a clip can be rendered again with other choices.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guise.app.deidentify.options import Audio, DeidentifyOptions
from guise.app.deidentify.report.report import outcome, verdict
from guise.app.deidentify.run.job import deidentify_file, pictures
from guise.app.deidentify.run.registry import open_engine
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.work import WorkFolder
from guise.app.media.containers import suffix_for
from guise.app.media.pictures import save_picture
from guise.app.studio.naming import user_names
from guise.app.studio.store import StudioError
from guise.app.swapping.cover import CoverStyle
from guise.app.swapping.decide import Action
from guise.common.files import write_whole
from guise.common.progress import Progress, mute

STEM = "out"
TRACKS = f"{STEM}.tracks.json"
REPORTS = (f"{STEM}.report.html", f"{STEM}.report.json")


@dataclass
class Choices:
    """The user's choices for a clip.

    Parameters
    ----------
    actions : by track.   donors : by person; "" lets Guise choose.  Keys are numbers as text, as in JSON.
    cover, alpha, audio : as in `guise.app.deidentify.options.Options`.
    """

    actions: dict[str, Action]
    donors: dict[str, str]
    cover: CoverStyle = DeidentifyOptions().cover
    alpha: float = DeidentifyOptions().alpha
    audio: Audio = DeidentifyOptions().audio

    @classmethod
    def proposed(cls, tracks: list[dict[str, Any]]) -> Choices:
        """The choices that Guise proposes.   tracks : from the file TRACKS."""
        actions = {str(track["track"]): track["action"] for track in tracks}
        return cls(actions, {str(track["person"]): track["donor"] for track in tracks})


def review(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Find the faces of a clip and propose what to do with them.

    about : source, the clip's path; name, the user's name for it.
    Returns the output's file name, the time of the last frame, and the number of pictures of each track.
    """
    source = Path(about["source"])
    output = folder / (STEM + suffix_for(source, DeidentifyOptions().encode.encoder))
    with user_names({source: about["name"]}), open_engine("local") as engine:
        deidentify_file(source, output, DeidentifyOptions(), engine, review=True, progress=progress, say=mute)
    case = Case(WorkFolder(_work(output)))
    shown = pictures(case, "pictures")
    for track, some in shown.items():
        for place, picture in enumerate(some):
            save_picture(folder / thumbnail(track, place), picture)
    counts = {str(track): len(some) for track, some in shown.items()}
    return {"output": output.name, "seconds": float(case.times[-1]), "pictures": counts}


def render(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Render a reviewed clip.

    about : source and name as for the review; review, its folder; output, its file name; choices, see `Choices`.
    Returns outcome, sentence, counts and problems of the report.
    """
    source, output, before = Path(about["source"]), folder / about["output"], Path(about["review"])
    choices = Choices(**about["choices"])
    if not before.exists():
        raise StudioError(f"the review of {about['name']} was deleted: upload the video again")
    shutil.copytree(_work(before / output.name), _work(output))
    write_whole(folder / TRACKS, _edited(before / TRACKS, choices))
    options = DeidentifyOptions(cover=choices.cover, alpha=choices.alpha, audio=choices.audio)
    names = about["name"] + source.suffix, download_name(about["name"], output.name)
    with user_names({source: about["name"]}), open_engine("local") as engine:
        report = deidentify_file(
            source, output, options, engine, resume=True, names=names, progress=progress, say=mute
        )
    assert report is not None
    return {
        "outcome": outcome(report), "sentence": verdict(report), "counts": report.counts,
        "problems": list(report.problems),
    }  # fmt: skip


def thumbnail(track: int, place: int) -> str:
    """File name of a picture of a track; places count from 0."""
    return f"{track}.{place}.jpg"


def download_name(clip: str, file: str) -> str:
    """The name under which a user downloads a file of a rendering.

    >>> download_name("party", "out.report.json")
    'party_deidentified.report.json'
    """
    return f"{clip}_deidentified{file.removeprefix(STEM)}"


def _work(output: Path) -> Path:
    return output.with_name(output.name + ".work")


def _edited(tracks: Path, choices: Choices) -> str:
    """The track file's text with the user's choices."""
    value = json.loads(tracks.read_text(encoding="utf-8"))
    for track in value["tracks"]:
        action, donor = choices.actions[str(track["track"])], choices.donors[str(track["person"])]
        track |= {"action": action, "donor": donor}
    return json.dumps(value)
