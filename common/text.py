"""Text that is safe to show."""


def printable(text: str) -> str:
    """The text with what is no sign to be seen, such as a terminal's commands in a file's name, written out.

    >>> printable("a\\x1b[2J b.mp4")
    'a\\\\x1b[2J b.mp4'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
