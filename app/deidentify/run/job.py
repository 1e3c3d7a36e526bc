"""A file from its input to its output and report: the stages in order, each resumed where an earlier run stopped."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

from guise.app.deidentify.options import DeidentifyError, DeidentifyOptions
from guise.app.deidentify.reach import PROPOSAL
from guise.app.deidentify.run.adding import add_tracks
from guise.app.deidentify.run.planning import (
    chosen_places,
    chosen_tracks,
    link_tracks,
    number_people,
    plan_faces,
    propose_tracks,
    things,
)
from guise.app.deidentify.run.redrawing import redrawn, telling_segments
from guise.app.deidentify.run.results import beside, report_of, write_reports, write_review
from guise.app.deidentify.stages.case import PLACES, Case, track_json
from guise.app.deidentify.stages.jobs import Job, result_of
from guise.app.deidentify.stages.pieces import publish
from guise.app.deidentify.stages.render import SegmentRenderer, entries_of
from guise.app.deidentify.stages.things import THINGS
from guise.app.deidentify.stages.work import MANIFEST, WorkFolder
from guise.app.deidentify.tracks import FileReport
from guise.app.media import Frame, MediaError, open_input, open_sink
from guise.app.media.outputs import check_free
from guise.app.media.segments import scan
from guise.common.files import fitting_name
from guise.common.progress import Progress, Say
from guise.common.threads import one_thread
from guise.common.version import VERSION

REGION = "region.json"  # the region for which the faces were fitted


class JobRunner(Protocol):
    """What runs jobs, see `guise.app.deidentify.run.engines`."""

    def run(self, jobs: Sequence[Job], done: Callable[[Job], None]) -> None:
        """Run all of them, in any order."""


def deidentify_file(
    input: Path, output: Path, options: DeidentifyOptions, engine: JobRunner, *, resume: bool = False,
    force: bool = False, review: bool = False, tracks: Path | None = None, names: tuple[str, str] | None = None,
    progress: Progress, say: Say,
) -> FileReport | None:  # fmt: skip
    """De-identify a file; None when it stops for a review.

    Parameters
    ----------
    input : a video, an image or a folder of images.
    output : where the result goes; reports and the work folder lie beside it.
    engine : runs the jobs.
    resume : continue what an earlier run left; after a review, with these options instead of the earlier ones.
    force : replace outputs and the work folder of an earlier run.
    review : stop before rendering, and write NAME.tracks.json and NAME.tracks.jpg.
    tracks : the edited NAME.tracks.json.
    names : what the reports call input and output, if not by their files' names.

    Raises
    ------
    MediaError, DeidentifyError, ModelError, OutputError
        One sentence; the work folder is kept where the run can be resumed.
    """
    start = time.perf_counter()
    work = _opened(input, output, options, resume=resume or tracks is not None, force=force)
    stages = _Stages(Case(work), engine, progress)
    stages.analyse()
    if review:
        write_review(stages.case, output)
        say(
            f"{input.name}: edit the actions in {beside(output, '.tracks.json')}, then run again with --resume"
        )
        return None
    edited = tracks or beside(output, ".tracks.json")
    if edited.exists() or tracks:
        say(f"{input.name}: the actions are taken from {edited.name}")
    stages.plan(edited if edited.exists() or tracks else None)
    if options.region == "face" and any(track.action == "swap" for track in stages.case.tracks):
        say(f"{input.name}: {PROPOSAL}")
    stages.render(say)
    _require_unchanged(stages.case)
    publish(stages.case, output, force=force)
    report = report_of(stages.case, names or (input.name, output.name), output, time.perf_counter() - start)
    write_reports(stages.case, report, output)
    work.remove()
    return report


def fingerprint(path: Path) -> str:
    """Identifies an input: SHA-256 of its size and its first and last mebibyte; of names and sizes for a folder."""
    digest = hashlib.sha256()
    if path.is_dir():
        for entry in sorted(path.iterdir()):
            digest.update(f"{entry.name} {entry.stat().st_size}\n".encode(errors="surrogateescape"))
        return digest.hexdigest()
    size = path.stat().st_size
    digest.update(str(size).encode())
    with path.open("rb") as file:
        digest.update(file.read(1 << 20))
        file.seek(max(0, size - (1 << 20)))
        digest.update(file.read())
    return digest.hexdigest()


def _require_unchanged(case: Case) -> None:
    """Raise DeidentifyError when the input is not the one that the run began with."""
    if fingerprint(case.input) != case.manifest["fingerprint"]:
        raise DeidentifyError(
            f"{case.input} was changed or replaced while it was being de-identified: start over with --force"
        )


def work_folder(output: Path) -> Path:
    """Where a run keeps its results until the output is complete, beside it."""
    return output.with_name(fitting_name(output.name, ".work"))


def _opened(
    input: Path, output: Path, options: DeidentifyOptions, *, resume: bool, force: bool
) -> WorkFolder:
    """The work folder, with the manifest of this very run in it."""
    work = WorkFolder(work_folder(output))
    if not (resume and work.has("published.json")):
        _require_possible(input, output, options, force)
    manifest = {
        "format": "guise-work", "version": 1, "guise": VERSION, "input": str(input.absolute()),
        "fingerprint": fingerprint(input), "options": options.as_json(), "name": input.name,
        "output": output.name,
    }  # fmt: skip
    if work.has(MANIFEST) and resume:
        _require_same(work, manifest)
        work.save_json(MANIFEST, manifest)
        return work
    if work.folder.exists() and not force:
        raise DeidentifyError(
            f"{work.folder} was left by a run that did not finish: continue with --resume, or start over with --force"
        )
    work.create()
    work.save_json(MANIFEST, manifest)
    return work


def _require_same(work: WorkFolder, manifest: dict[str, Any]) -> None:
    """Raise DeidentifyError when a work folder is of another run; options count once a result depends on them."""
    left = work.load_json(MANIFEST)
    if not work.has("tracks.json"):
        left["options"] = manifest["options"]
    if left != manifest:
        raise DeidentifyError(
            f"{work.folder} is from a run with another input, other options or another version: give the same, "
            "or start over with --force"
        )


def _require_possible(input: Path, output: Path, options: DeidentifyOptions, force: bool) -> None:
    """Raise what reading the input or writing the output would raise, before any work is done."""
    with open_input(input, part=options.read) as media:
        check_free(output, media, force)
        probe = output.with_name(
            f"probe-{hashlib.sha256(os.fsencode(output.name)).hexdigest()[:8]}{output.suffix}"
        )
        try:
            open_sink(probe, media, options.encode, force=True, private=not options.keep_metadata).abort()
        except MediaError as error:
            raise MediaError(str(error).replace(probe.name, output.name)) from error


def replanned(folder: Path, tracks: Path, options: DeidentifyOptions) -> Case:
    """A reviewed case with the edited tracks and these options, to look at; what is in its work folder stays so."""
    work = WorkFolder(folder)
    work.save_json(MANIFEST, work.load_json(MANIFEST) | {"options": options.as_json()})
    work.save_json(PLACES, chosen_places(Case(work), tracks))
    case = Case(work)
    work.save_json("tracks.json", [track_json(track) for track in chosen_tracks(case, tracks)])
    work.save_arrays("plan.npz", **plan_faces(case, case.tracks))
    return case


def draw_frames(case: Case, frames: Sequence[Frame]) -> None:
    """Draw consecutive frames of a planned case in place, as they will be rendered; the last one is for looking at."""
    first, last = frames[0].index, frames[-1].index + 1
    segment = next(k for k in range(len(case.scan.segments)) if last <= case.span(k)[1])
    with one_thread(), SegmentRenderer(case, segment, entries_of(case.plan, first, last)) as drawing:
        for frame in frames:
            drawing.draw(frame)


class _Stages:
    """The stages of a case, and their progress."""

    def __init__(self, case: Case, engine: JobRunner, progress: Progress) -> None:
        self.case, self._engine, self._progress = case, engine, progress

    def analyse(self) -> None:
        """Up to the proposed actions."""
        case = self.case
        self._once("scan.json", lambda: scan(case.input, part=case.options.read).as_json())
        self._map("detect", range(len(case.scan.segments)))
        self._once("link.json", lambda: link_tracks(case))
        self._map("person", range(len(case.linked)))
        self._once("people.json", lambda: number_people(case))
        self._forget_other_region()
        self._map("fit", range(len(case.scan.segments)))
        self._once(THINGS, lambda: things(case))
        self._once("proposed.json", lambda: [track_json(track) for track in propose_tracks(case)])

    def _forget_other_region(self) -> None:
        """Which faces can be swapped depends on what is replaced, and a review may have been of something else."""
        work, region = self.case.work, self.case.options.region
        if work.has(REGION) and work.load_json(REGION) != region:
            work.forget("fit.*.npz", REGION)  # what was proposed is what the user has reviewed
        self._once(REGION, lambda: region)

    def plan(self, edited: Path | None) -> None:
        """The actions of the user, the donors, and what happens to each face in each frame."""
        self._once(PLACES, lambda: chosen_places(self.case, edited))
        self.case = case = Case(self.case.work)
        if add_tracks(case):
            self.case = case = Case(case.work)
            self.analyse()
        self._once("tracks.json", lambda: [track_json(track) for track in chosen_tracks(case, edited)])
        if not case.work.has("plan.npz"):
            case.work.save_arrays("plan.npz", **plan_faces(case, case.tracks))

    def render(self, say: Say) -> None:
        """All segments of the output, those that tell most first, and again while somebody is still recognised.

        A trial of a few frames finds the faces that hide people, which what is rendered may contradict.
        """
        every = tuple(range(len(self.case.scan.segments)))
        telling = telling_segments(self.case)
        for stage, segments in dict.fromkeys((("trial", telling), ("render", telling), ("render", every))):
            self._map(stage, segments)
            while redrawn(self.case, stage, say):
                self.case = Case(self.case.work)
                self._map(stage, segments)

    def _once(self, name: str, make: Callable[[], Any]) -> None:
        if not self.case.work.has(name):
            self.case.work.save_json(name, make())

    def _map(self, stage: str, numbers: Iterable[int]) -> None:
        work, finished = self.case.work, 0
        jobs = [Job(stage, str(work.folder), i) for i in numbers]
        missing = [job for job in jobs if not work.has(result_of(stage, job.index))]

        def done(job: Job) -> None:
            nonlocal finished
            finished += 1
            self._progress(_STAGE_LABELS[stage], finished / max(len(missing), 1))

        self._progress(_STAGE_LABELS[stage], 0.0)
        self._engine.run(missing, done)


_STAGE_LABELS = {
    "detect": "finding faces", "person": "enrolling", "fit": "tracking", "trial": "choosing faces",
    "render": "rendering",
}  # fmt: skip
