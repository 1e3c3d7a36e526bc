"""The jobs behind the page Swap: find and learn the people of a clip, and render it with the user's choices.

A finding's folder holds people.npz, who is where; scan.json, the frames; NUMBER.jpg, a picture of each person; and
NUMBER.guise, their model.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from guise.aam.landmarks import LbpDetector, open_landmarker
from guise.aam.model import Identity
from guise.app.drawing.look import SWAP, DrawingChoices
from guise.app.media import open_input
from guise.app.media.pictures import letterboxed, save_picture
from guise.app.media.segments import Scan, scan
from guise.app.media.time_range import Outside, TimeRange
from guise.app.people.finding import find_people
from guise.app.people.found import load_people, save_people
from guise.app.studio.option_form import EncodingOptions, taken
from guise.app.studio.pictures import fitted_to, frames_until, output_suffix
from guise.app.studio.store import StudioError
from guise.app.swapping.donors import open_face
from guise.app.swapping.policy import Unsure
from guise.app.swapping.puppet import Puppet, puppet_file
from guise.app.swapping.report import SwapError, SwapReport, SwapSettings
from guise.app.swapping.several import Casting, KnownVideo, Others, draw_frame, learn_person, swap_people
from guise.common.arrays import U8
from guise.common.files import write_json
from guise.common.option import option
from guise.common.progress import Progress, silent

PEOPLE, SCAN, REPORT, STEM = "people.npz", "scan.json", "report.json", "out"


@dataclass
class SwapChoices:
    """The user's choices: faces by the numbers of people, as text; what happens to the others.

    mode : "puppet" animates the face's own head with the expressions of the first person who gets one.
    """

    faces: dict[str, str]
    others: Others = "leave"
    mode: Literal["swap", "puppet"] = "swap"

    def casting(self) -> Casting:
        """As `swap_people` takes them."""
        return Casting(self.faces, self.others)


@dataclass(frozen=True)
class SwapOptions:
    """What else a user can say, as on the command line."""

    start: str | None = option(
        None, "Where the part to swap begins: seconds, 1:30 or 1:02:30.", name="--from", metavar="TIME"
    )
    end: str | None = option(None, "Where it ends; default: with the video.", name="--to", metavar="TIME")
    outside: Outside = option("keep", "What lies outside that part: keep it as it is, or cut it off.")
    unsure: Unsure = option(
        "cover", "A face that is lost but may be visible: cover it, hold the last face, or leave it."
    )


OPTIONS = (SwapOptions, DrawingChoices, EncodingOptions)


def settings_from(values: Mapping[str, Any], progress: Progress) -> SwapSettings:
    """Settings for options by their names on the command line."""
    own = taken(SwapOptions, values)
    return SwapSettings(
        look=taken(DrawingChoices, values).of(SWAP), encode=taken(EncodingOptions, values).options(), unsure=own.unsure,
        part=TimeRange.between(own.start, own.end, own.outside), progress=progress,
    )  # fmt: skip


def find(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Find the people of a clip and learn them.

    about : source, the clip's path; name, the user's name for it.
    Returns the number of frames, the one to show first, and for each person their number, frames, and why they can't
    be learned, or "".
    """
    source = Path(about["source"])
    settings = SwapSettings(progress=progress)
    with open_input(source) as media:
        found = find_people(media, lambda share: progress("finding people", share))
        if not found.people:
            if media.kind == "image":
                raise StudioError(f"nobody is seen in {about['name']}: use a photo that shows a face larger")
            raise StudioError(f"nobody is seen long enough in {about['name']}: use a longer or clearer video")
        write_json(folder / SCAN, scan(source).as_json())
        people = []
        for person in found.people:
            save_picture(folder / f"{person.number}.jpg", person.thumbnail)
            why = ""
            try:
                learn_person(media, found, person, settings).save(folder / f"{person.number}.guise")
            except SwapError as error:
                why = str(error)
            people.append({"number": person.number, "frames": len(person.frames), "why_not": why})
    save_people(folder / PEOPLE, found)
    seen = Counter(int(frame) for person in found.people for frame in person.frames)
    first = max(seen, key=lambda frame: (seen[frame], -abs(frame - found.count // 3)))
    return {"frames": found.count, "first": first, "people": people}


def render(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Swap a clip.

    about : source and name as for the finding; found, its folder; choices, see `SwapChoices`; options.
    Returns the output's file name, and the report of `swap_people` or `puppet_file`.
    """
    source, before = Path(about["source"]), Path(about["found"])
    if not before.exists():
        raise StudioError(f"what was found in {about['name']} was deleted: choose the video again")
    settings = settings_from(about.get("options", {}), progress)
    output = folder / (STEM + output_suffix(source, settings.encode.encoder))
    choices, known = SwapChoices(**about["choices"]), known_video(before)
    report: SwapReport
    if choices.mode == "puppet":
        driver, face = _puppet(choices, known)
        report = puppet_file(source, face, output, source=driver, settings=settings)
    else:
        report = swap_people(source, choices.casting(), output, settings=settings, known=known)
    facts = report.as_json() | {"output": output.name}
    write_json(folder / REPORT, facts)
    return facts


def preview(
    source: Path, found: Path, choices: SwapChoices, frame: int, width: int, options: Mapping[str, Any]
) -> tuple[U8, U8]:
    """A frame before and after, RGB (h, w, 3).

    found : folder of the finding.   width : pixels, at most.   options : by their names on the command line.
    """
    frames = Scan.from_json(json.loads((found / SCAN).read_text(encoding="utf-8")))
    some = frames_until(source, frames, frame)
    before = fitted_to(some[-1].rgb(), width)
    if choices.mode == "puppet":
        driver, face = _puppet(choices, known_video(found))
        with Puppet(driver, face, LbpDetector(), landmarker=open_landmarker("builtin")) as puppet:
            for one in some:
                puppet.swap(one)
        return before, letterboxed(some[-1].rgb(), before.shape[1], before.shape[0])
    rate = float(1 / (np.median(np.diff(frames.pts)) * frames.time_base)) if frames.frames > 1 else 1.0
    settings = settings_from(options, silent)
    draw_frame(source.name, some, choices.casting(), known_video(found), rate, settings=settings)
    return before, fitted_to(some[-1].rgb(), width)


def _puppet(choices: SwapChoices, known: KnownVideo) -> tuple[Identity, Identity]:
    """Who drives, and whose head moves."""
    for number, face in choices.faces.items():
        if int(number) in known.models:
            return known.models[int(number)], open_face(face)
    raise StudioError("choose a face for at least one person")


@lru_cache(maxsize=2)  # of previews, one after the other
def known_video(folder: Path) -> KnownVideo:
    """What a finding's folder holds."""
    found = load_people(folder / PEOPLE)
    paths = {person.number: folder / f"{person.number}.guise" for person in found.people}
    return KnownVideo(
        found, {number: Identity.load(path) for number, path in paths.items() if path.is_file()}
    )
