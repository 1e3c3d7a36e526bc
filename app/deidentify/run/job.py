"""A file from its input to its output and report: the stages in order, each resumed where an earlier run stopped."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from guise.aam.recognition import same_person
from guise.app.deidentify.options import DeidentifyError, DeidentifyOptions
from guise.app.deidentify.report.page import write_page
from guise.app.deidentify.report.report import write_report
from guise.app.deidentify.report.review import read_tracks, write_tracks
from guise.app.deidentify.report.sheet import contact_sheet
from guise.app.deidentify.stages.case import Case, LinkedTrack, track_from, track_json
from guise.app.deidentify.stages.jobs import Job, result_of
from guise.app.deidentify.stages.people import LIMITS as ENROLMENT
from guise.app.deidentify.stages.people import why_not
from guise.app.deidentify.stages.pieces import publish
from guise.app.deidentify.stages.render import SegmentRenderer, entries_of
from guise.app.deidentify.stages.work import MANIFEST, WorkFolder
from guise.app.deidentify.tracks import BYSTANDERS, AuditFinding, FileReport, Track, TrackOutcome
from guise.app.media import Frame, MediaError, open_input, open_sink
from guise.app.media.pictures import save_picture
from guise.app.media.segments import scan
from guise.app.media.sink import check_free
from guise.app.people.link import Tracklet, link
from guise.app.swapping.decide import (
    COVERED,
    LEFT,
    SWAPPED,
    Action,
    Bystanders,
    Decision,
    TrackObservations,
    decide,
)
from guise.app.swapping.donors import KeyFile, assign, bare
from guise.common.arrays import F32
from guise.common.progress import Progress, Say
from guise.common.threads import one_thread
from guise.common.version import version

MAX_CONFIDENCE_PARTS = 100  # of a track's curve
MIN_SWAP_SHARE = 0.05  # of a track's frames that must be fit to swap; otherwise all of it is covered
REGION = "region.json"  # the region for which the faces were fitted
HEAD_COVER_GROWTH = 1.35  # of covers, so that they hide hair and outline as well


class JobRunner(Protocol):
    """What runs jobs, see `guise.app.deidentify.run.engines`."""

    def run(self, jobs: Sequence[Job], done: Callable[[Job], None]) -> None:
        """Run all of them, in any order."""


def beside(output: Path, suffix: str) -> Path:
    """A file beside the output under its name: NAME.report.json and the like."""
    return output.with_name(output.stem + suffix)


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
        _write_review(stages.case, output)
        say(
            f"{input.name}: edit the actions in {beside(output, '.tracks.json')}, then run again with --resume"
        )
        return None
    edited = tracks or beside(output, ".tracks.json")
    if edited.exists() or tracks:
        say(f"{input.name}: the actions are taken from {edited.name}")
    stages.plan(edited if edited.exists() or tracks else None)
    stages.render()
    publish(stages.case, output, force=force)
    report = _report(stages.case, names or (input.name, output.name), output, time.perf_counter() - start)
    _write_report(stages.case, report, output)
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


def _opened(
    input: Path, output: Path, options: DeidentifyOptions, *, resume: bool, force: bool
) -> WorkFolder:
    """The work folder, with the manifest of this very run in it."""
    work = WorkFolder(output.with_name(output.name + ".work"))
    if not (resume and work.has("published.json")):
        _require_possible(input, output, options, force)
    manifest = {
        "format": "guise-work", "version": 1, "guise": version(), "input": str(input.absolute()),
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
    with open_input(input) as media:
        check_free(output, media, force)
        probe = output.with_name(f"probe-{output.name}")
        try:
            open_sink(probe, media, options.encode, force=True, private=not options.keep_metadata).abort()
        except MediaError as error:
            raise MediaError(str(error).replace(probe.name, output.name)) from error


def replanned(folder: Path, tracks: Path, options: DeidentifyOptions) -> Case:
    """A reviewed case with the edited tracks and these options, to look at; what is in its work folder stays so."""
    work = WorkFolder(folder)
    work.save_json(MANIFEST, work.load_json(MANIFEST) | {"options": options.as_json()})
    case = Case(work)
    work.save_json("tracks.json", [track_json(track) for track in _ordered(case, tracks)])
    work.save_arrays("plan.npz", **_plan(case))
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
        self._once("scan.json", lambda: scan(case.input).as_json())
        self._map("detect", len(case.scan.segments))
        self._once("link.json", lambda: _link_tracks(case))
        self._map("person", len(case.linked))
        self._once("people.json", lambda: _people(case))
        self._forget_other_region()
        self._map("fit", len(case.scan.segments))
        self._once("proposed.json", lambda: [track_json(track) for track in _proposed(case)])

    def _forget_other_region(self) -> None:
        """Which faces can be swapped depends on what is replaced, and a review may have been of something else."""
        work, region = self.case.work, self.case.options.region
        if work.has(REGION) and work.load_json(REGION) != region:
            work.forget("fit.*.npz", REGION)  # what was proposed is what the user has reviewed
        self._once(REGION, lambda: region)

    def plan(self, edited: Path | None) -> None:
        """The actions of the user, the donors, and what happens to each face in each frame."""
        case = self.case
        self._once("tracks.json", lambda: [track_json(track) for track in _ordered(case, edited)])
        if not case.work.has("plan.npz"):
            case.work.save_arrays("plan.npz", **_plan(case))

    def render(self) -> None:
        """All segments of the output."""
        self._map("render", len(self.case.scan.segments))

    def _once(self, name: str, make: Callable[[], Any]) -> None:
        if not self.case.work.has(name):
            self.case.work.save_json(name, make())

    def _map(self, stage: str, count: int) -> None:
        work, finished = self.case.work, 0
        jobs = [Job(stage, str(work.folder), i) for i in range(count)]
        missing = [job for job in jobs if not work.has(result_of(stage, job.index))]

        def done(job: Job) -> None:
            nonlocal finished
            finished += 1
            self._progress(_STAGE_LABELS[stage], finished / max(len(missing), 1))

        self._progress(_STAGE_LABELS[stage], 0.0)
        self._engine.run(missing, done)


_STAGE_LABELS = {"detect": "finding faces", "person": "enrolling", "fit": "tracking", "render": "rendering"}


# -- between the stages ---------------------------------------------------------------------------------------


def _link_tracks(case: Case) -> dict[str, Any]:
    found = [case.found(k, points=False) for k in range(len(case.scan.segments))]
    chains, cuts = link(found, [s.first for s in case.scan.segments], case.rate)
    tracks = []
    for number, chain in enumerate(chains, start=1):
        rows = [(p, np.flatnonzero(found[p.segment].tracklet == p.number)) for p in chain]
        tracks.append(_linked_track(number, chain, [(found[p.segment], r) for p, r in rows]))
    return {"cuts": cuts, "tracks": tracks}


def _linked_track(number: int, chain: Sequence[Tracklet], rows: Sequence[tuple[Any, Any]]) -> dict[str, Any]:
    frames = np.concatenate([one.frame[r] for one, r in rows])
    boxes = np.concatenate([one.box[r] for one, r in rows])
    confidence = np.concatenate([one.confidence[r] for one, r in rows])
    parts = np.array_split(np.arange(len(frames)), min(6, len(frames)))
    shown = [int(frames[part[np.argmax(confidence[part])]]) for part in parts]
    return {
        "number": number, "pieces": [[p.segment, p.number] for p in chain], "first": int(frames[0]),
        "last": int(frames[-1]), "seen": len(frames), "width": float(np.median(boxes[:, 2] - boxes[:, 0])),
        "sure": int((confidence >= ENROLMENT.min_confidence).sum()), "shown": shown,
    }  # fmt: skip


def _people(case: Case) -> dict[str, int]:
    """By track, the person: tracks of one person who left and returned have the number of the first of them."""
    people: dict[str, int] = {}
    for track in case.linked:
        model = case.enrolled(track.number)
        earlier = [
            t for t in case.linked if people.get(str(t.number)) == t.number and not _together(t, track)
        ]
        known = (t.number for t in earlier if model is not None and _same(case, t, model))
        people[str(track.number)] = next(known, track.number)
    return people


def _same(case: Case, track: LinkedTrack, model: Any) -> bool:
    other = case.enrolled(track.number)
    return other is not None and same_person(other, model)


def _together(a: LinkedTrack, b: LinkedTrack) -> bool:
    return a.first <= b.last and b.first <= a.last


def _observations(case: Case, track: LinkedTrack) -> tuple[TrackObservations, F32]:
    """The observations of a track, and the confidence of its landmarks (n,)."""
    frames, boxes, turns, trust, confidence = [], [], [], [], []
    for segment, number in track.pieces:
        found, fits = case.found(segment, points=False), case.fits(segment)
        rows = np.flatnonzero(found.tracklet == number)
        mine = np.flatnonzero(fits.track == track.number)
        known = dict(zip(fits.frame[mine].tolist(), fits.confidence[mine].tolist(), strict=True))
        frames.append(found.frame[rows])
        boxes.append(found.box[rows])
        turns.append(found.turn[rows])
        trust.append([known.get(int(f), 0.0) for f in found.frame[rows]])
        confidence.append(found.confidence[rows])
    return TrackObservations(
        np.concatenate(frames),
        np.concatenate(boxes),
        np.concatenate(turns),
        np.concatenate(trust).astype(np.float32),
    ), np.concatenate(confidence)


def _decided(case: Case, track: LinkedTrack, action: Any) -> Decision:
    rows, _ = _observations(case, track)
    return decide(rows, action, total=case.scan.frames, rate=case.rate, cuts=case.cuts)


def _proposed(case: Case) -> list[Track]:
    tracks = []
    for one in case.linked:
        rows, confidence = _observations(case, one)
        decision = decide(rows, "swap", total=case.scan.frames, rate=case.rate, cuts=case.cuts)
        inside = (decision.frames >= one.first) & (decision.frames <= one.last)
        share = float((decision.done[inside] == SWAPPED).mean())
        reason = _why_cover(case, one, share)
        action: Action = "cover" if reason else "swap"
        tracks.append(Track(
            one.number, case.people[one.number], one.first, one.last, one.seen, round(one.width, 1),
            _curve(one, rows.frames, rows.trust if rows.trust.any() else confidence), action, reason, action,
            can_swap=case.model_of(one.number) is not None,
        ))  # fmt: skip
    return tracks


def _why_cover(case: Case, track: LinkedTrack, share: float) -> str:
    if case.model_of(track.number) is None:
        return why_not(track) or str(case.work.load_json(f"person.{track.number - 1}.json"))
    return "" if share >= MIN_SWAP_SHARE else "hardly any frame shows the face well enough"


def _curve(track: LinkedTrack, frames: NDArray[np.int32], values: F32) -> tuple[float, ...]:
    whole = np.zeros(track.last - track.first + 1)
    whole[frames - track.first] = values
    parts = np.array_split(whole, min(MAX_CONFIDENCE_PARTS, len(whole)))
    return tuple(round(float(part.mean()), 3) for part in parts)


def _ordered(case: Case, edited: Path | None) -> list[Track]:
    """The tracks with the user's actions, and donors for those that are swapped."""
    proposed = [track_from(entry) for entry in case.work.load_json("proposed.json")]
    tracks = proposed
    if edited is not None:
        tracks = list(read_tracks(edited, proposed, case.manifest["fingerprint"]))
    origins = {t.number: t.origin for t in tracks}
    donors = _donors(
        case, {t.person: origins[t.person] for t in tracks if t.action == "swap" and not t.donor}
    )
    return [replace(t, donor=t.donor or donors[t.person] if t.action == "swap" else "") for t in tracks]


def _donors(case: Case, people: Mapping[int, int]) -> dict[int, str]:
    """The donor of each person, given with the track that they are called by; with a key file, the one of before."""
    options, salt = case.options, case.manifest["name"]
    if options.keyfile is None:
        return assign(list(people), options.donor, own=options.gallery, seed=options.seed, salt=salt)
    models = {person: case.model_of(track) for person, track in people.items()}
    return KeyFile.open(options.keyfile).assign(models, options.donor, own=options.gallery, salt=salt)


def _plan(case: Case) -> dict[str, NDArray[Any]]:
    """What happens to each face in each frame, by frame."""
    columns: list[tuple[NDArray[Any], ...]] = []
    linked = {one.number: one for one in case.linked}
    for track in case.tracks:
        whole = linked[track.origin]
        d = _decided(case, whole, track.action)
        mine = (d.frames >= track.first) | (track.first == whole.first)
        mine &= (d.frames <= track.last) | (track.last == whole.last)
        parts = (d.frames, d.done, d.boxes, d.turns, d.growth, d.confidence)
        columns.append((np.full(int(mine.sum()), track.number), *(part[mine] for part in parts)))
    b = _bystanders(case)
    ones = np.ones(len(b.frames))
    columns.append(
        (np.full(len(ones), BYSTANDERS), b.frames, ones * COVERED, b.boxes, b.turns, ones, b.scores)
    )
    joined = [np.concatenate(parts) for parts in zip(*columns, strict=True)]
    order = np.argsort(joined[1], kind="stable")
    names = ("track", "frame", "done", "box", "turn", "growth", "confidence")
    types = (np.int32, np.int32, np.uint8, *[np.float32] * 4)
    if case.options.region == "head":
        joined[names.index("growth")] *= HEAD_COVER_GROWTH
    return {n: a[order].astype(t) for n, a, t in zip(names, joined, types, strict=True)}


def _bystanders(case: Case) -> Bystanders:
    found = [case.found(k, points=False) for k in range(len(case.scan.segments))]
    seen = Bystanders(
        np.concatenate([f.bystander_frame for f in found]),
        np.concatenate([f.bystander_box for f in found]),
        np.concatenate([f.bystander_score for f in found]),
        np.concatenate([f.bystander_turn for f in found]),
    )
    return seen.spread(total=case.scan.frames, rate=case.rate, cuts=case.cuts)


# -- results --------------------------------------------------------------------------------------------------


def _report(case: Case, names: tuple[str, str], output: Path, seconds: float) -> FileReport:
    renders = [case.work.load_json(f"render.{k}.json") for k in range(len(case.scan.segments))]
    problems = [p for k in range(len(case.scan.segments)) for p in case.work.load_json(f"problems.{k}.json")]
    problems += [p for r in renders for p in r["problems"]] + case.work.load_json("published.json")
    findings = [
        AuditFinding(a["frame"], tuple(a["box"]), a["score"], a["covered"])
        for r in renders
        for a in r["audit"]
    ]
    plan = case.plan
    with open_input(case.input) as media:
        width, height = media.width, media.height
    return FileReport(
        *names, case.scan.frames, case.times, width, height, case.tracks,
        tuple(_outcome(plan, n) for n in [*(t.number for t in case.tracks), BYSTANDERS]), tuple(findings),
        _counts(plan, case.scan.frames, findings), {**_settings(case.options), "renderer": renders[0]["renderer"]},
        tuple(dict.fromkeys(problems)), round(seconds, 3), _digest(output), sum(r["searched"] for r in renders),
    )  # fmt: skip


def _settings(options: DeidentifyOptions) -> dict[str, Any]:
    """The options as reported: files without their folders, whose names may identify somebody."""
    named = {
        k: v and Path(v).name for k, v in options.as_json().items() if k in ("keyfile", "certificate", "key")
    }
    gallery = [path.name for path in options.gallery]
    detector = options.detector and options.detector.partition(":")[0]
    return (
        options.as_json() | named | {"donor": bare(options.donor), "gallery": gallery, "detector": detector}
    )


def _digest(path: Path) -> str:
    """SHA-256 of a file, "" for a folder."""
    if path.is_dir():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _outcome(plan: dict[str, NDArray[Any]], track: int) -> TrackOutcome:
    mine = np.flatnonzero(plan["track"] == track)
    boxes = np.round(plan["box"][mine]).astype(np.int32)
    return TrackOutcome(track, plan["frame"][mine], plan["done"][mine], plan["confidence"][mine], boxes)


def _counts(plan: dict[str, NDArray[Any]], frames: int, findings: Sequence[AuditFinding]) -> dict[str, int]:
    worst = np.full(frames, -1)
    for rank, code in enumerate((SWAPPED, COVERED, LEFT)):
        these = plan["frame"][plan["done"] == code]
        worst[these] = np.maximum(worst[these], rank)
    covered = [finding.frame for finding in findings]
    worst[covered] = np.maximum(worst[covered], 1)
    names = ("without face", "swapped", "covered", "left")
    return {name: int((worst == rank).sum()) for rank, name in enumerate(names, start=-1)}


def pictures(case: Case, kind: Literal["pictures", "output"]) -> dict[int, list[NDArray[np.uint8]]]:
    """The tracks' pictures of the input or of the output, in the order of time."""
    found: dict[int, list[NDArray[np.uint8]]] = {track.number: [] for track in case.linked}
    for k in range(len(case.scan.segments)):
        for name, picture in case.work.load_arrays(f"{kind}.{k}.npz").items():
            found.setdefault(int(name.split(".")[0]), []).append(picture)
    return found


def split_review(folder: Path, output: Path, splits: Mapping[int, Sequence[int]]) -> None:
    """Write the tracks of a review again, as proposed, with some of them split, see `split_tracks`.

    folder : the work folder.   output : as for the review.
    """
    _write_review(Case(WorkFolder(folder)), output, splits)


def _write_review(case: Case, output: Path, splits: Mapping[int, Sequence[int]] | None = None) -> None:
    """The tracks to edit and their pictures, readable by their owner only, as they show faces of the input."""
    tracks = [track_from(entry) for entry in case.work.load_json("proposed.json")]
    table, sheet = beside(output, ".tracks.json"), beside(output, ".tracks.jpg")
    write_tracks(
        table, tracks, input_name=case.manifest["name"], fingerprint=case.manifest["fingerprint"],
        frames=case.scan.frames, seconds=case.times, splits=splits,
    )  # fmt: skip
    save_picture(sheet, contact_sheet(pictures(case, "pictures"), tracks, case.times))
    for path in (table, sheet):
        path.chmod(0o600)


def _write_report(case: Case, report: FileReport, output: Path) -> None:
    write_report(beside(output, ".report.json"), report)
    write_page(beside(output, ".report.html"), report, pictures(case, "output"))
