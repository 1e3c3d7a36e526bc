"""From an exception to one sentence and an exit code.

2: a user's mistake.  130: interrupted.  1: a fault of Guise itself; GUISE_DEBUG=1 shows where.
"""

from __future__ import annotations

import errno
import os
import sys
import traceback

from guise.common.errors import GuiseError, Interrupted
from guise.common.text import printable

USER_MISTAKE = 2
FAULT = 1
INTERRUPTED = 130


def report(error: BaseException) -> int:
    """Print `error: ...` on stderr and return the exit code."""
    if isinstance(error, KeyboardInterrupt):
        print("error: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    trace(error)
    sentence, code = explain(error)
    print(f"error: {sentence}", file=sys.stderr)
    return code


def trace(error: BaseException) -> None:
    """Print the traceback of a fault of Guise, if GUISE_DEBUG=1 asks for it."""
    if os.environ.get("GUISE_DEBUG") == "1" and explain(error)[1] == FAULT:
        traceback.print_exception(error)


def explain(error: BaseException) -> tuple[str, int]:
    """One sentence for an exception, and its exit code."""
    if hasattr(error, "format_message"):  # a mistake on the command line, as typer puts it
        return _one_line(error.format_message()), USER_MISTAKE
    if isinstance(error, Interrupted):
        return str(error), INTERRUPTED
    if isinstance(error, GuiseError):
        return _one_line(str(error)), USER_MISTAKE
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return "the disk is full: free some space, or write to another disk", USER_MISTAKE
    if isinstance(error, OSError) and error.filename is not None:
        return _one_line(f"{error.filename}: {error.strerror or error}"), USER_MISTAKE
    if isinstance(error, MemoryError):
        return "there is not enough memory; use fewer --frames or a lower --resolution", USER_MISTAKE
    detail = _one_line(str(error)) or "no message"
    return f"Guise failed ({type(error).__name__}: {detail}); GUISE_DEBUG=1 shows where", FAULT


def _one_line(text: str) -> str:
    return printable(" ".join(text.split()))
