"""A batch: every file gets its entry, a bad one stops nothing, and the exit code tells the worst."""

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guise.app.deidentify.covers import BYSTANDER
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.report.report import BatchEntry, write_report
from guise.app.deidentify.run import batch
from guise.app.deidentify.run.batch import BatchRun, exit_code, run_batch, write_summary
from guise.app.deidentify.run.engines import JobEngine, SerialEngine
from guise.app.deidentify.run.inputs import FilePair, make_plan
from guise.app.deidentify.run.results import beside
from guise.app.deidentify.tracks import BYSTANDERS, FileReport, TrackOutcome
from guise.app.media import MediaError
from guise.common.progress import Progress


def report_of(source: Path, output: Path, covered: int) -> FileReport:
    """A report of ten frames, in some of which a bystander was covered."""
    rows = TrackOutcome(
        BYSTANDERS, np.arange(covered, dtype=np.int32), np.ones(covered, np.uint8), np.ones(covered, np.float32),
        np.full(covered, BYSTANDER, np.uint8), np.zeros((covered, 4), np.int32),
    )  # fmt: skip
    return FileReport(source.name, output.name, 10, np.arange(10) / 30, 320, 240, (), (rows,), ())


class Watched:
    """Remembers what a batch tells."""

    def __init__(self) -> None:
        self.entries: list[BatchEntry] = []
        self.notes: list[str] = []
        self.stages: list[tuple[str, str]] = []

    def file(self, name: str) -> Progress:
        return lambda stage, share: self.stages.append((name, stage))

    def note(self, text: str) -> None:
        self.notes.append(text)

    def finished(self, entry: BatchEntry) -> None:
        self.entries.append(entry)


class Several(SerialEngine):
    """An engine that says it could do several jobs."""

    workers = 3

    def __init__(self) -> None:
        super().__init__(lambda job: None)
        self.closed = threading.Event()

    def close(self) -> None:
        self.closed.set()


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Path, dict[str, Any]]]:
    """Files are not de-identified but written at once; what they were asked for is remembered."""
    asked: list[tuple[Path, dict[str, Any]]] = []

    def fake(
        source: Path, output: Path, options: DeidentifyOptions, engine: JobEngine, **more: Any
    ) -> FileReport | None:
        asked.append((source, more))
        more["progress"]("rendering", 0.5)
        if "bad" in source.name:
            raise MediaError(f"{source} is not a video.")
        if "fault" in source.name:
            raise ZeroDivisionError("x")
        if more["review"]:
            return None
        if output.suffix:
            output.write_bytes(source.read_bytes()[::-1])
        report = report_of(source, output, 3 if "covered" in source.name else 0)
        write_report(beside(output, ".report.json"), report)
        return report

    monkeypatch.setattr(batch, "deidentify_file", fake)
    return asked


def pairs_of(*inputs: str, output: str | None = None) -> list[FilePair]:
    return make_plan(inputs, output, Path("work"), lambda path: path.suffix, recursive=False).pairs


def make(*names: str) -> None:
    for name in names:
        Path(name).write_bytes(b"film")


RUN = BatchRun(DeidentifyOptions(), SerialEngine(lambda job: None))


@pytest.mark.parametrize("engine", [SerialEngine(lambda job: None), Several()])
def test_a_bad_file_does_not_stop_the_others(here: Path, done: list[Any], engine: JobEngine) -> None:
    make("a.mp4", "bad.mp4", "covered.mp4", "fault.mp4", "z.mp4")
    watched = Watched()
    entries = run_batch(pairs_of("."), replace(RUN, engine=engine), watched)
    assert [(e.input, e.output, e.code) for e in entries] == [
        ("a.mp4", "a_deidentified.mp4", 0),
        ("bad.mp4", None, 1),
        ("covered.mp4", "covered_deidentified.mp4", 3),
        ("fault.mp4", None, 1),
        ("z.mp4", "z_deidentified.mp4", 0),
    ]
    assert entries[1].sentence == "bad.mp4 is not a video."
    assert entries[3].sentence.startswith("fault.mp4: Guise failed (ZeroDivisionError: x)")
    assert entries[2].counts["covered"] == 3
    assert sorted(watched.entries, key=lambda e: e.input) == entries
    assert ("a.mp4", "rendering") in watched.stages
    assert exit_code(entries) == 1


@pytest.mark.parametrize(("codes", "code"), [([0, 0], 0), ([0, 3], 3), ([3, 1], 1), ([0, 1], 1), ([], 0)])
def test_the_worst_decides_the_exit_code(codes: list[int], code: int) -> None:
    assert exit_code([BatchEntry("a", "b", c, "", {}) for c in codes]) == code


def test_files_are_done_at_once_where_the_engine_can(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    together = threading.Barrier(3, timeout=30)

    def meet(source: Path, output: Path, *more: Any, **named: Any) -> FileReport:
        together.wait()
        return report_of(source, output, 0)

    monkeypatch.setattr(batch, "deidentify_file", meet)
    make("a.mp4", "b.mp4", "c.mp4")
    entries = run_batch(pairs_of("."), replace(RUN, engine=Several()), Watched())
    assert exit_code(entries) == 0


def test_a_key_file_makes_the_order_matter(here: Path) -> None:
    assert replace(RUN, engine=Several()).at_once(5) == 3
    assert replace(RUN, engine=Several()).at_once(2) == 2
    assert replace(RUN, engine=Several(), options=DeidentifyOptions(keyfile=here / "key")).at_once(5) == 1


def test_an_interruption_ends_the_engine_and_comes_through(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = Several()

    def stop(source: Path, *more: Any, **named: Any) -> FileReport:
        if source.name == "a.mp4":
            raise KeyboardInterrupt
        assert engine.closed.wait(30)
        raise MediaError("the run was stopped")

    monkeypatch.setattr(batch, "deidentify_file", stop)
    make("a.mp4", "b.mp4", "c.mp4")
    with pytest.raises(KeyboardInterrupt):
        run_batch(pairs_of("."), replace(RUN, engine=engine), Watched())


def test_resuming_leaves_what_is_there_and_remembers_what_became_of_it(here: Path, done: list[Any]) -> None:
    make("a.mp4", "covered.mp4", "z.mp4", "z_deidentified.mp4")
    first = run_batch(pairs_of("a.mp4", "covered.mp4"), RUN, Watched())
    before = (here / "a_deidentified.mp4").stat().st_mtime_ns
    done.clear()
    make("new.mp4")
    again = run_batch(
        pairs_of("a.mp4", "covered.mp4", "new.mp4", "z.mp4"), replace(RUN, resume=True), Watched()
    )
    assert again[:2] == first
    assert [source.name for source, _ in done] == ["new.mp4"]
    assert done[0][1]["resume"]
    assert again[3].sentence == "It existed already, without a report."
    assert (here / "a_deidentified.mp4").stat().st_mtime_ns == before


def test_a_review_writes_nothing(here: Path, done: list[Any]) -> None:
    make("a.mp4")
    (entry,) = run_batch(pairs_of("a.mp4"), replace(RUN, review=True), Watched())
    assert (entry.code, entry.output) == (0, None)


def test_folders_of_outputs_are_made(here: Path, done: list[Any]) -> None:
    make("a.mp4")
    run_batch(pairs_of("a.mp4", output="new/deep/"), RUN, Watched())
    assert (here / "new/deep/a_deidentified.mp4").exists()


def test_the_summary_names_every_file(here: Path) -> None:
    entries = [
        BatchEntry("a.mp4", "a_deidentified.mp4", 0, "Fine.", {"swapped": 3}),
        BatchEntry("b", None, 1, "No.", {}),
    ]
    make("c.mp4", "d.mp4")
    page = here / write_summary(pairs_of("c.mp4", "d.mp4", output="."), entries)
    assert page.parent == here
    assert "a.mp4" in page.read_text()
    told = json.loads(page.with_suffix(".json").read_text())
    assert (told["files"], told["failed"]) == (2, 1)
    assert [pair.name for pair in pairs_of(".")] == ["c.mp4", "d.mp4"]


# -- elsewhere --------------------------------------------------------------------------------------------------


@pytest.fixture
def bucket() -> Iterator[Any]:
    """fsspec's memory with two files in /films."""
    fsspec = pytest.importorskip("fsspec", reason="the cluster extra is not installed")
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    for name in ("a.mp4", "covered.mp4"):
        memory.pipe_file(f"/films/{name}", b"film")
    yield memory
    memory.store.clear()


def test_files_elsewhere_come_and_go(here: Path, done: list[Any], bucket: Any) -> None:
    entries = run_batch(pairs_of("memory://films", output="memory://out/"), RUN, Watched())
    assert [(e.code, e.output) for e in entries] == [
        (0, "memory://out/a_deidentified.mp4"),
        (3, "memory://out/covered_deidentified.mp4"),
    ]
    assert bucket.cat_file("/out/a_deidentified.mp4") == b"mlif"
    assert json.loads(bucket.cat_file("/out/covered_deidentified.report.json"))["outcome"] == 3
    assert list(here.iterdir()) == []
    done.clear()
    again = run_batch(
        pairs_of("memory://films", output="memory://out/"), replace(RUN, resume=True), Watched()
    )
    assert again == entries
    assert done == []


def test_the_summary_goes_where_the_outputs_go(here: Path, bucket: Any) -> None:
    entries = [BatchEntry("a.mp4", "a_deidentified.mp4", 0, "Fine.", {})] * 2
    page = write_summary(pairs_of("memory://films", output="memory://out/"), entries)
    assert page.startswith("memory://out/deidentify-")
    assert b"a.mp4" in bucket.cat_file(page.removeprefix("memory:/"))
    assert list(here.iterdir()) == []


def test_a_file_elsewhere_that_fails_is_kept_here_and_resumed(
    here: Path, done: list[Any], bucket: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (pair,) = pairs_of("memory://films/a.mp4", output="memory://out/")

    def refuse(path: Path, url: str) -> None:
        raise batch.remote.RemoteError(f"{url} cannot be written")

    with monkeypatch.context() as patch:
        patch.setattr(batch.remote, "put", refuse)
        (entry,) = run_batch([pair], RUN, Watched())
    assert entry.code == 1
    assert pair.input.parent.stat().st_mode & 0o777 == 0o700
    bucket.rm_file("/films/a.mp4")
    done.clear()
    (entry,) = run_batch([pair], replace(RUN, resume=True), Watched())
    assert (entry.code, entry.output) == (0, "memory://out/a_deidentified.mp4")
    assert done == []
    assert bucket.cat_file("/out/a_deidentified.mp4") == b"mlif"
    assert list(here.iterdir()) == []


def test_an_input_elsewhere_that_vanished_is_a_sentence(here: Path, done: list[Any], bucket: Any) -> None:
    pairs = pairs_of("memory://films/a.mp4", output="out/")
    bucket.rm_file("/films/a.mp4")
    (entry,) = run_batch(pairs, RUN, Watched())
    assert (
        entry.sentence == "memory://films/a.mp4 does not exist: give a file, a folder or a pattern that does"
    )


def test_a_file_elsewhere_that_is_gone_counts_as_unreadable(here: Path, done: list[Any], bucket: Any) -> None:
    pairs = pairs_of("memory://films/a.mp4", output="out/")
    bucket.rm_file("/films/a.mp4")
    (entry,) = run_batch(pairs, RUN, Watched())
    assert entry.code == exit_code([entry]) == 2
