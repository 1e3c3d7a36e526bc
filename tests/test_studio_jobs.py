"""The studio's jobs: one at a time, in a process of their own, and none is lost."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import studio_work

from guise.app.studio.jobs import Finish, JobQueue
from guise.app.studio.store import JobRow, Store, StudioError
from guise.common.processes import ChildProcess

KINDS = ("write", "wait", "mistake", "fault", "crash")
TIMEOUT_SECONDS = 60.0  # on a busy machine


@contextmanager
def running(folder: Path, finish: Finish | None = None) -> Iterator[JobQueue]:
    """A queue at work; `finish` is for what "write" has made."""
    store = Store(folder)
    jobs = JobQueue(store)
    for kind in KINDS:
        jobs.register(kind, getattr(studio_work, kind), finish if kind == "write" else None)
    jobs.open()
    try:
        yield jobs
    finally:
        jobs.close()
        store.close()


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + TIMEOUT_SECONDS
    while not holds():
        assert time.monotonic() < end, "nothing has happened"
        time.sleep(0.02)


def ended(jobs: JobQueue, id: str) -> JobRow:
    until(lambda: jobs.store.job(id).ended)
    return jobs.store.job(id)


@pytest.mark.usefixtures("no_thread_left")
def test_a_job_runs_elsewhere_and_its_result_is_kept(tmp_path: Path) -> None:
    with running(tmp_path) as jobs:
        done = ended(jobs, jobs.start("write", {"text": "hello"}))
        assert (done.state, done.share) == ("done", 1.0)
        assert done.result["process"] != os.getpid()
        assert (jobs.store.folder_of(done.id) / "out.txt").read_text() == "hello"


@pytest.mark.slow
def test_jobs_run_one_after_the_other(tmp_path: Path) -> None:
    flag = tmp_path / "flag"
    with running(tmp_path / "studio") as jobs:
        first = jobs.start("wait", {"until": str(flag)})
        second = jobs.start("write", {"text": ""})
        until(lambda: jobs.store.job(first).share == 0.25)
        assert jobs.store.job(first).stage == "waiting"
        assert jobs.store.job(second).state == "waiting"
        flag.touch()
        assert ended(jobs, second).state == "done"
        assert jobs.store.job(first).state == "done"


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("mistake", "there is no face: use another clip"),
        ("fault", "Guise failed (KeyError: 'x'); GUISE_DEBUG=1 shows where"),
        ("crash", "the job ended unexpectedly (exit code 7): start it again"),
    ],
)
@pytest.mark.slow
def test_a_failure_is_one_sentence_and_leaves_no_file(tmp_path: Path, kind: str, sentence: str) -> None:
    with running(tmp_path) as jobs:
        job = ended(jobs, jobs.start(kind, {}))
        assert (job.state, job.sentence) == ("failed", sentence)
        until(lambda: not jobs.store.folder_of(job.id).exists())
        assert ended(jobs, jobs.start("write", {"text": ""})).state == "done"


def test_a_failure_has_the_users_names_of_the_files(tmp_path: Path) -> None:
    with running(tmp_path) as jobs:
        job = ended(jobs, jobs.start("mistake", {"files": {"/studio/clip": "Party"}}))
    assert job.sentence == "there is no face: use another Party"


@pytest.mark.slow
def test_a_cancelled_job_ends_and_leaves_no_file(tmp_path: Path) -> None:
    with running(tmp_path) as jobs:
        first = jobs.start("wait", {"until": str(tmp_path / "never")})
        second = jobs.start("write", {"text": ""})
        until(lambda: jobs.store.job(first).share == 0.25)
        jobs.cancel(second)
        jobs.cancel(first)
        last = jobs.start("write", {"text": ""})
        assert ended(jobs, last).state == "done"
        assert [jobs.store.job(id).state for id in (first, second)] == ["cancelled"] * 2
        assert not jobs.store.folder_of(first).exists()
        jobs.cancel(last)
        assert jobs.store.job(last).state == "done"


@pytest.mark.slow
def test_files_are_put_in_place_when_a_job_is_done(tmp_path: Path) -> None:
    place = tmp_path / "place"
    with running(tmp_path / "studio", studio_work.leave) as jobs:
        assert ended(jobs, jobs.start("write", {"text": "hello", "at": str(place)})).state == "done"
        assert place.read_text() == "hello"
        nowhere = str(tmp_path / "nowhere" / "place")
        assert ended(jobs, jobs.start("write", {"text": "hello", "at": nowhere})).state == "failed"


def test_a_job_that_is_cancelled_after_its_work_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process has said that it is done; before the queue acts on that, the user cancels."""
    place = tmp_path / "place"
    receive = ChildProcess.receive
    with running(tmp_path / "studio", studio_work.leave) as jobs:

        def late(process: ChildProcess) -> Any:
            change = receive(process)
            if change["state"] == "done":
                jobs.cancel(jobs.store.jobs()[0].id)
            return change

        monkeypatch.setattr(ChildProcess, "receive", late)
        job = ended(jobs, jobs.start("write", {"text": "hello", "at": str(place)}))
        until(lambda: not jobs.store.folder_of(job.id).exists())
    assert job.state == "cancelled"
    assert not place.exists()


@pytest.mark.slow
def test_a_job_that_the_studio_left_runs_again(tmp_path: Path) -> None:
    flag = tmp_path / "flag"
    with running(tmp_path / "studio") as jobs:
        first = jobs.start("wait", {"until": str(flag)})
        second = jobs.start("write", {"text": "later"})
        until(lambda: jobs.store.job(first).share == 0.25)
    flag.touch()
    with running(tmp_path / "studio") as jobs:
        assert ended(jobs, second).state == "done"
        assert jobs.store.job(first).state == "done"
    assert flag.with_suffix(".begun").read_text() == "xx"


def test_the_process_ends_with_a_studio_that_died(tmp_path: Path) -> None:
    """A killed studio cannot clean up; its job's process sees that and ends by itself."""
    code = f"from pathlib import Path; from studio_work import die; die(Path({str(tmp_path)!r}))"
    here = Path(__file__).parent
    died = subprocess.run(
        [sys.executable, "-c", code], cwd=here.parent, env=os.environ | {"PYTHONPATH": f"{here}:."}
    )
    assert died.returncode == -signal.SIGKILL
    assert (tmp_path / "never.begun").exists()
    with (tmp_path / "never.begun").open() as file:
        until(lambda: _is_free(file.fileno()))


def _is_free(file: int) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def test_an_unknown_kind_is_refused(tmp_path: Path) -> None:
    with running(tmp_path) as jobs, pytest.raises(StudioError, match="there are no jobs of kind dance"):
        jobs.start("dance", {})


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.slow
def test_a_job_that_is_removed_while_it_runs_does_not_hold_up_the_next(tmp_path: Path) -> None:
    flag = tmp_path / "flag"
    with running(tmp_path / "studio") as jobs:
        first = jobs.start("wait", {"until": str(flag)})
        until(lambda: jobs.store.job(first).share == 0.25)
        jobs.store.remove_job(first)
        flag.touch()
        assert ended(jobs, jobs.start("write", {"text": ""})).state == "done"
