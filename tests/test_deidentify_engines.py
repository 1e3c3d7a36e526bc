"""Engines: every job is done, whoever does it and whatever happens to them; errors keep their type."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from engine_jobs import act
from process_work import alive, wait_until
from threadpoolctl import threadpool_info

from guise.app.deidentify.run.engines import (
    MAX_STARTS_OF_KILLED_JOB,
    EngineError,
    JobEngine,
    LocalEngine,
    SerialEngine,
    attempt,
)
from guise.app.deidentify.run.registry import open_engine
from guise.app.deidentify.stages.jobs import Job
from guise.app.media import MediaError

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parent


def jobs(folder: Path, stage: str = "", count: int = 5) -> list[Job]:
    return [Job(stage, str(folder), i) for i in range(count)]


def finished(folder: Path) -> list[int]:
    return sorted(int(file.stem) for file in folder.glob("*.done"))


@pytest.fixture(scope="module")
def local() -> Iterator[LocalEngine]:
    """Two processes, which start once for several tests."""
    with LocalEngine(2, act) as engine:
        yield engine


@pytest.fixture(params=["serial", "local"])
def engine(request: pytest.FixtureRequest) -> JobEngine:
    one: JobEngine = SerialEngine(act) if request.param == "serial" else request.getfixturevalue("local")
    return one


def test_all_jobs_are_done_and_told_here(engine: JobEngine, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    engine.run(jobs(tmp_path), lambda job: told.append((job.index, threading.get_ident())))
    assert sorted(told) == [(i, threading.get_ident()) for i in range(5)]
    assert finished(tmp_path) == list(range(5))


def test_an_error_keeps_its_type_and_cancels_the_rest(engine: JobEngine, tmp_path: Path) -> None:
    told: list[int] = []
    with pytest.raises(MediaError) as caught:
        engine.run(jobs(tmp_path, "bad", 200), lambda job: told.append(job.index))
    assert str(caught.value) == "clip.mp4 is not a video."
    assert len(finished(tmp_path)) < 100
    assert set(told) <= set(finished(tmp_path))
    engine.run(jobs(tmp_path, "", 3), lambda job: None)


def test_people_are_enrolled_two_at_a_time(tmp_path: Path) -> None:
    together, limits = threading.Barrier(2, timeout=30), list[set[int]]()

    def enrol(job: Job) -> None:
        together.wait()
        limits.append(
            {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}
        )

    told: list[int] = []
    with SerialEngine(enrol) as engine:
        engine.run(jobs(tmp_path, "person", 4), lambda job: told.append(job.index))
    assert told == [0, 1, 2, 3]
    assert limits == [{1}] * 4


def test_an_enrolment_that_fails_cancels_those_that_wait(tmp_path: Path) -> None:
    begun: list[int] = []

    def enrol(job: Job) -> None:
        begun.append(job.index)
        if job.index == 0:
            raise MediaError("clip.mp4 is not a video.")
        time.sleep(0.2)

    with SerialEngine(enrol) as engine, pytest.raises(MediaError):
        engine.run(jobs(tmp_path, "person", 20), lambda job: None)
    assert len(begun) < 10


def test_several_threads_share_an_engine(engine: JobEngine, tmp_path: Path) -> None:
    folders = [tmp_path / name for name in "abc"]
    for folder in folders:
        folder.mkdir()
    failures: list[Exception] = []

    def file(folder: Path) -> None:
        try:
            engine.run(jobs(folder, "bad" if folder.name == "b" else ""), lambda job: None)
        except MediaError as error:
            failures.append(error)

    threads = [threading.Thread(target=file, args=(folder,)) for folder in folders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [finished(folders[0]), finished(folders[2])] == [list(range(5))] * 2
    assert len(failures) == 1


def test_an_error_that_cannot_be_sent_is_told_in_words(tmp_path: Path) -> None:
    error = attempt(Job("odd", str(tmp_path), 0), act)
    assert isinstance(error, RuntimeError)
    assert str(error) == "Odd: ab"


def test_a_sent_error_holds_where_it_was_raised(local: LocalEngine, tmp_path: Path) -> None:
    with pytest.raises(MediaError) as caught:
        local.run(jobs(tmp_path, "bad"), lambda job: None)
    assert any("engine_jobs.py" in note for note in caught.value.__notes__)


def test_processes_are_used_and_have_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with LocalEngine(2, act) as engine:
        engine.run(jobs(tmp_path, "environment", 1), lambda job: None)
    assert (tmp_path / "0.done").read_text() != str(os.getpid())
    assert (tmp_path / "threads").read_text() == "1"


def test_a_killed_worker_is_replaced(tmp_path: Path) -> None:
    with LocalEngine(2, act) as engine:
        engine.run(jobs(tmp_path, "killed once", 6), lambda job: None)
    assert (tmp_path / "killed").exists()
    assert finished(tmp_path) == list(range(6))


def test_a_job_that_always_kills_is_given_up_and_the_others_are_not(tmp_path: Path) -> None:
    bad, good = tmp_path / "bad", tmp_path / "good"
    bad.mkdir()
    good.mkdir()
    with LocalEngine(2, act) as engine:
        beside = threading.Thread(target=lambda: engine.run(jobs(good, "slow", 12), lambda job: None))
        beside.start()
        with pytest.raises(
            EngineError, match=rf"was killed {MAX_STARTS_OF_KILLED_JOB} times \(exit code -9\)"
        ):
            engine.run(jobs(bad, "killed"), lambda job: None)
        beside.join()
    assert (bad / "kills").read_text() == "x" * MAX_STARTS_OF_KILLED_JOB
    assert finished(good) == list(range(12))


def test_closing_ends_the_processes_at_once(tmp_path: Path) -> None:
    said: list[Exception] = []
    others = set(multiprocessing.active_children())

    def run() -> None:
        try:
            engine.run(jobs(tmp_path, "endless", 3), lambda job: None)
        except EngineError as error:
            said.append(error)

    with LocalEngine(2, act) as engine:
        runner = threading.Thread(target=run)
        runner.start()
        wait_until(lambda: len([file for file in tmp_path.glob("*.begun") if file.read_text()]) == 2)
    runner.join()
    assert str(said[0]) == "the run was stopped; use --resume to continue"
    assert not any(alive(int(file.read_text())) for file in tmp_path.glob("*.begun"))
    assert set(multiprocessing.active_children()) <= others


COMMAND = """
import sys
from guise.app.deidentify.run.engines import LocalEngine
from guise.app.deidentify.stages.jobs import Job
from engine_jobs import act
from process_work import alive, wait_until
if __name__ == "__main__":
    with LocalEngine(2, act) as engine:
        engine.run([Job("endless", sys.argv[1], i) for i in range(4)], print)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_command(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "command.py"
    script.write_text(COMMAND)
    path = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    command = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)], env=os.environ | {"PYTHONPATH": path}, stderr=subprocess.PIPE
    )  # fmt: skip
    wait_until(lambda: len([file for file in tmp_path.glob("*.begun") if file.read_text()]) == 2)
    pids = [int(file.read_text()) for file in tmp_path.glob("*.begun")]
    assert all(map(alive, pids))
    command.send_signal(number)
    command.communicate(timeout=60)
    wait_until(lambda: not any(map(alive, pids)), 10)


@pytest.mark.parametrize(
    ("spec", "workers", "sentence"),
    [
        (
            "cloud",
            None,
            "engine must be local or dask:ADDRESS, such as dask:tcp://10.0.0.5:8786; got 'cloud'",
        ),
        (
            "dask:",
            None,
            "engine must be local or dask:ADDRESS, such as dask:tcp://10.0.0.5:8786; got 'dask:'",
        ),
        (
            "dask:tcp://127.0.0.1:1",
            3,
            "--workers is for the local engine only: a cluster uses the workers that were started for it",
        ),
    ],
)
def test_an_engine_that_does_not_exist(spec: str, workers: int | None, sentence: str) -> None:
    with pytest.raises(EngineError) as caught:
        open_engine(spec, workers)
    assert str(caught.value) == sentence


def test_the_local_engine_uses_processes_when_there_are_several_workers() -> None:
    assert isinstance(open_engine("local", 1), SerialEngine)
    with open_engine("local", 3) as engine:
        assert isinstance(engine, LocalEngine)
        assert engine.workers == 3
    with open_engine("local") as engine:
        assert 1 <= engine.workers <= max(1, (os.cpu_count() or 1) // 2)
