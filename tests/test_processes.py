"""Child processes: they answer, they end when they are told to, and none outlives the program that started it."""

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import process_work
import pytest
from process_work import alive, wait_until

from guise.common.processes import ChildProcess

TESTS = Path(__file__).parent


@contextmanager
def child(function: Callable[..., None], *arguments: object, daemon: bool = True) -> Iterator[ChildProcess]:
    process = ChildProcess(function, *arguments, name="guise test", daemon=daemon)
    try:
        yield process
    finally:
        process.kill()


def test_messages_go_both_ways_until_the_function_returns() -> None:
    with child(process_work.echo, "said") as process:
        process.send("hello")
        assert process.receive() == ("said", "hello", "guise test")
        assert process.exit_code is None
        process.send(None)
        with pytest.raises(EOFError):
            process.receive()
        process.close()
        assert process.exit_code == 0
    assert not multiprocessing.active_children()


def test_closing_ends_a_process_that_listens() -> None:
    with child(process_work.echo, "said") as process:
        process.close()
        assert process.exit_code is not None


def test_a_killed_process_is_seen_at_once() -> None:
    with child(process_work.hang) as process:
        pid = process.receive()
        process.kill()
        assert not alive(pid)
        assert process.exit_code == -signal.SIGKILL
        with pytest.raises(EOFError):
            process.receive()
        with pytest.raises(OSError, match="pipe"):
            process.send("hello")


@pytest.mark.parametrize(("stubborn", "number"), [(False, signal.SIGTERM), (True, signal.SIGKILL)])
def test_a_process_that_does_not_end_in_time_is_killed(stubborn: bool, number: int) -> None:
    with child(process_work.hang, stubborn) as process:
        process.receive()
        process.terminate(10.0 if not stubborn else 0.2)
        process.close()
        assert process.exit_code == -number


def test_ctrl_c_is_left_to_the_parent() -> None:
    with child(process_work.echo, "said") as process:
        process.send("hello")
        process.receive()
        pid = multiprocessing.active_children()[0].pid
        assert pid is not None
        os.kill(pid, signal.SIGINT)
        process.send("again")
        assert process.receive()[1] == "again"


def test_a_process_that_is_no_daemon_may_start_others() -> None:
    with child(process_work.start_another, daemon=False) as process:
        assert process.receive() == "said by another"


COMMAND = """
import sys
import process_work
from guise.common.processes import ChildProcess
if __name__ == "__main__":
    child = ChildProcess(process_work.hang)
    print(child.receive(), flush=True)
    child.receive()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_program(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "command.py"
    script.write_text(COMMAND)
    program = subprocess.Popen(
        [sys.executable, str(script)], env=os.environ | {"PYTHONPATH": str(TESTS)}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert program.stdout is not None
    pid = int(program.stdout.readline())
    assert alive(pid)
    program.send_signal(number)
    program.communicate(timeout=60)
    wait_until(lambda: not alive(pid), 10)


def test_what_is_sent_must_be_for_pickle() -> None:
    """A function that is not at the top level of a module is refused here, before a process runs."""

    def nested(pipe: Connection) -> None: ...

    with pytest.raises((AttributeError, TypeError), match="nested"):
        ChildProcess(nested)
