"""The jobs behind the page Swap: find and learn the people of a clip, and render it with the user's choices.

A finding's folder holds people.npz, who is where; scan.json, the frames; NUMBER.jpg, a picture of each person; and
NUMBER.guise, their model.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from guise.aam.landmarks import LbpDetector, open_landmarker
from guise.aam.model import Identity
from guise.app.media import EncodeOptions, open_input
from guise.app.media.pictures import letterboxed, save_picture
from guise.app.media.segments import Scan, scan
from guise.app.people.finding import find_people
from guise.app.people.found import load_people, save_people
from guise.app.studio.pictures import fitted_to, frames_until, output_suffix
from guise.app.studio.store import StudioError
from guise.app.swapping.donors import open_face
from guise.app.swapping.puppet import Puppet, puppet_file
from guise.app.swapping.report import SwapError, SwapReport, SwapSettings
from guise.app.swapping.several import Casting, KnownVideo, Others, draw_frame, learn_person, swap_people
from guise.common.arrays import U8
from guise.common.files import write_json
from guise.common.progress import Progress

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

    about : source and name as for the finding; found, its folder; choices, see `SwapChoices`.
    Returns the output's file name, and the report of `swap_people` or `puppet_file`.
    """
    source, before = Path(about["source"]), Path(about["found"])
    if not before.exists():
        raise StudioError(f"what was found in {about['name']} was deleted: choose the video again")
    settings = SwapSettings(encode=EncodeOptions(), progress=progress)
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


def preview(source: Path, found: Path, choices: SwapChoices, frame: int, width: int) -> tuple[U8, U8]:
    """A frame before and after, RGB (h, w, 3).   found : folder of the finding.   width : pixels, at most."""
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
    draw_frame(source.name, some, choices.casting(), known_video(found), rate)
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
