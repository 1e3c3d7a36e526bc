"""The Dask engine with a real scheduler and workers: jobs survive their workers, and errors are sentences."""

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from clips import empty_scene
from engine_jobs import act
from process_work import wait_until
from test_deidentify_engines import finished, jobs

from guise.app.cli.main import main
from guise.app.deidentify.run.engines import EngineError
from guise.app.deidentify.run.registry import open_engine
from guise.app.media import MediaError

distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")

from guise.app.deidentify.run import cluster  # noqa: E402
from guise.app.deidentify.run.cluster import DaskEngine, attempt_there, versions  # noqa: E402

TESTS = Path(__file__).parent
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning"),
    pytest.mark.slow,
]


def start(*arguments: str) -> subprocess.Popen[bytes]:
    """A `dask` command."""
    path = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        env=os.environ | {"PYTHONPATH": path}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = start(*arguments)
    try:
        yield process
    finally:
        process.terminate()  # a nanny takes its worker with it
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def scheduler() -> Iterator[str]:
    address = f"tcp://127.0.0.1:{free_port()}"
    port = address.rsplit(":", 1)[1]
    with started("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--no-show"):
        yield address


@contextmanager
def worker(address: str, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    with started("worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny", *more) as process:
        yield process


def wait_for_workers(address: str, count: int) -> None:
    with distributed.Client(address, timeout=30, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=60)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A scheduler with two workers."""
    with scheduler() as address, worker(address), worker(address):
        wait_for_workers(address, 2)
        yield address


def test_all_jobs_are_done_by_both_workers(address: str, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    with DaskEngine(address, act) as engine:
        assert engine.workers == 2
        engine.run(jobs(tmp_path, "slow", 8), lambda job: told.append((job.index, threading.get_ident())))
    assert sorted(told) == [(i, threading.get_ident()) for i in range(8)]
    assert finished(tmp_path) == list(range(8))
    pids = {file.read_text() for file in tmp_path.glob("*.done")}
    assert len(pids) == 2
    assert str(os.getpid()) not in pids


def test_an_error_keeps_its_type_and_cancels_the_rest(address: str, tmp_path: Path) -> None:
    with DaskEngine(address, act) as engine:
        with pytest.raises(MediaError) as caught:
            engine.run(jobs(tmp_path, "bad", 200), lambda job: None)
        assert str(caught.value) == "clip.mp4 is not a video."
        assert len(finished(tmp_path)) < 199
        engine.run(jobs(tmp_path, "", 3), lambda job: None)


def test_several_threads_share_an_engine(address: str, tmp_path: Path) -> None:
    folders = [tmp_path / name for name in "abc"]
    with DaskEngine(address, act) as engine:
        threads = [
            threading.Thread(target=lambda f=folder: engine.run(jobs(f), lambda job: None))
            for folder in folders
        ]
        for folder, thread in zip(folders, threads, strict=True):
            folder.mkdir()
            thread.start()
        for thread in threads:
            thread.join()
    assert [finished(folder) for folder in folders] == [list(range(5))] * 3


def test_a_worker_killed_mid_run_loses_nothing(address: str, tmp_path: Path) -> None:
    with worker(address) as doomed:
        wait_for_workers(address, 3)
        with DaskEngine(address, act) as engine:
            runner = threading.Thread(target=lambda: engine.run(jobs(tmp_path, "slow", 18), lambda job: None))
            runner.start()
            wait_until(lambda: any(f.read_text() == str(doomed.pid) for f in tmp_path.glob("*.begun")))
            doomed.send_signal(signal.SIGKILL)
            runner.join()
    assert finished(tmp_path) == list(range(18))
    assert {int(f.read_text()) for f in tmp_path.glob("*.done")} - {doomed.pid}


def test_a_job_that_kills_every_worker_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Read by the scheduler; by default it takes four deaths, each followed by a slow start.
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "1")
    arguments = ("--nthreads", "1", "--no-dashboard")
    with scheduler() as address, started("worker", address, *arguments):  # a nanny starts killed ones again
        wait_for_workers(address, 1)
        with (
            DaskEngine(address, act) as engine,
            pytest.raises(EngineError, match="every worker that ran it was killed"),
        ):
            engine.run(jobs(tmp_path, "killed", 2), lambda job: None)
    assert len((tmp_path / "kills").read_text()) == 2


def test_a_scheduler_that_goes_is_a_sentence(tmp_path: Path) -> None:
    caught: list[EngineError] = []

    def run() -> None:
        try:
            engine.run(jobs(tmp_path, "slow", 100), lambda job: None)
        except EngineError as error:
            caught.append(error)

    address = f"tcp://127.0.0.1:{free_port()}"
    port = address.rsplit(":", 1)[1]
    arguments = ("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--no-show")
    with started(*arguments) as doomed, worker(address):
        wait_for_workers(address, 1)
        engine = DaskEngine(address, act)
        runner = threading.Thread(target=run)
        runner.start()
        wait_until(lambda: any(tmp_path.glob("*.begun")))
        doomed.kill()
        runner.join()
        engine.close()
    assert str(caught[0]) == (
        f"the Dask scheduler at {address} is gone: start it and its workers again, then continue with --resume"
    )


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere.invalid:8786", "gopher://x:1", "!!"])
def test_no_scheduler_is_a_sentence(address: str) -> None:
    with pytest.raises(EngineError) as caught:
        open_engine(f"dask:{address}")
    assert str(caught.value) == (
        f"there is no Dask scheduler at {address}: start one with: dask scheduler, and give the address that it prints"
    )


def test_a_scheduler_without_workers_is_a_sentence() -> None:
    with scheduler() as address, pytest.raises(EngineError) as caught:
        open_engine(f"dask:{address}")
    assert (
        str(caught.value)
        == f"the Dask scheduler at {address} has no workers: start some with: dask worker {address}"
    )


def test_a_missing_extra_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(EngineError, match=r'pip install "guise-video\[cluster\]"'):
        open_engine("dask:tcp://127.0.0.1:1")


def test_other_versions_on_a_worker_are_a_sentence(tmp_path: Path) -> None:
    job = jobs(tmp_path)[0]
    error = attempt_there(job, act, versions() | {"av": "1.2.3"})
    assert isinstance(error, EngineError)
    assert f"has av {versions()['av']} and not 1.2.3" in str(error)
    assert finished(tmp_path) == []
    assert attempt_there(job, act, versions()) is None


def test_a_worker_that_does_not_see_the_folder_is_a_sentence(tmp_path: Path) -> None:
    error = attempt_there(jobs(tmp_path / "elsewhere")[0], act, versions())
    assert isinstance(error, EngineError)
    assert "under the same path" in str(error)


def test_a_job_that_is_done_twice_is_not_done_at_the_same_time(address: str, tmp_path: Path) -> None:
    """As when a command was killed and is resumed while the workers still do its jobs."""
    caught: list[Exception] = []

    def command() -> None:
        try:
            with DaskEngine(address, act) as engine:
                engine.run(jobs(tmp_path, "alone", 1), lambda job: None)
        except Exception as error:
            caught.append(error)

    commands = [threading.Thread(target=command) for _ in range(4)]
    for one in commands:
        one.start()
    for one in commands:
        one.join()
    assert caught == []


@pytest.fixture
def bucket() -> Iterator[None]:
    """A film behind a URL."""
    fsspec = pytest.importorskip("fsspec", reason="the cluster extra is not installed")
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    memory.pipe_file("/films/in/x/c.mp4", empty_scene(Path("c.mp4")).read_bytes())
    yield
    memory.store.clear()


def test_the_commands_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """As they stand there, but for the scheduler's address, and with fsspec's memory as the object storage."""
    monkeypatch.chdir(tmp_path)
    request.getfixturevalue("bucket")
    for name in ("videos/a.mp4", "videos/x/b.mp4"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        empty_scene(Path(name))
    port = str(free_port())
    changes = {"10.0.0.5": "127.0.0.1", "8786": port, "s3://": "memory://", "--nworkers 4": "--nworkers 1"}
    page = (TESTS.parent / "docs" / "cluster.md").read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in page
        page = page.replace(old, new)
    lines = [
        line for block in re.findall(r"^```sh\n(.*?)^```", page, re.M | re.S) for line in block.splitlines()
    ]
    dask = [shlex.split(line)[1:] for line in lines if line.startswith("dask ")]
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("guise ")]
    assert [len(dask), len(commands)] == [2, 5]
    with started(*dask[0], "--no-dashboard"), started(*dask[1], "--no-dashboard"):
        wait_for_workers(f"tcp://127.0.0.1:{port}", 1)
        outputs = []
        for command in commands:
            if "--resume" not in command:
                shutil.rmtree("out", ignore_errors=True)
            assert main([*command, "-q"]) == 0, command
            outputs.append({str(f): f.read_bytes() for f in Path("out").rglob("*.mp4")})
    assert set(outputs[0]) == {"out/a_deidentified.mp4", "out/x/b_deidentified.mp4"}
    assert outputs[0] == outputs[1] == outputs[2]
    assert set(outputs[4]) - set(outputs[3]) == {"out/x/c_deidentified.mp4"}


def test_the_versions_are_those_of_what_computes() -> None:
    assert set(versions()) == {"guise", "python", *cluster.LIBRARIES}
    assert "none" not in versions().values()
