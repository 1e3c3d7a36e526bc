"""Errors that a user may see: one sentence, no traceback."""


class GuiseError(ValueError):
    """A user's mistake, or a problem with their files or computer: exit code 2.

    `str(error)` is one sentence: what was expected, what was found, what to do.
    """


class OutputError(GuiseError):
    """An output that cannot be written."""


class Interrupted(Exception):
    """Work that the user interrupted; the message says what is left of it."""
