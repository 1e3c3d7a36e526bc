"""The command line, `guise COMMAND`: environment, signals and exit codes.

What the commands are stands in `guise.app.cli.commands`, which is imported only when one is run: `guise --version`
needs none of them.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import NoReturn

_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",  # read when NumPy is imported; see guise.common.threads
    "OPENCV_LOG_LEVEL": "SILENT",  # a broken image is reported by Guise's own message
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code; an error is one sentence on stderr."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        from guise.common.version import VERSION

        print(f"guise {VERSION}")
        return 0
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with _terminated_like_interrupted():
        code = _run(arguments)
        from guise.common.failures import INTERRUPTED

        if argv is None and code == INTERRUPTED:
            _end(code)
    return code


@contextlib.contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt in the main thread; afterwards the caller's handler is back."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL if before is None else before)


def _run(arguments: list[str]) -> int:
    from guise.common.failures import INTERRUPTED, report

    try:
        code = _call(arguments)
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else 1
    except BaseException as error:
        return report(error)
    return report(KeyboardInterrupt()) if code == INTERRUPTED else code


def _call(arguments: list[str]) -> int:
    from guise.app.cli.commands import Abort, command_line

    run = command_line(arguments[0] if arguments else None)
    try:
        return int(run(arguments or ["--help"], standalone_mode=False, prog_name="guise") or 0)
    except Abort:
        raise KeyboardInterrupt from None


def _end(code: int) -> NoReturn:
    """End the program without waiting for threads of native libraries.

    An interrupt may leave them at work, and C++ aborts a program that ends before its threads do.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)


def _terminate(number: int, frame: object) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
