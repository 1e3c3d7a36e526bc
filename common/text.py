"""Text that is safe to show."""


def printable(text: str) -> str:
    """The text with unprintable characters escaped, such as terminal commands in a file's name.

    >>> printable("a\\x1b[2J b.mp4")
    'a\\\\x1b[2J b.mp4'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def counted(number: int, word: str) -> str:
    """A number of things, in words.

    >>> counted(1, "face"), counted(1200, "frame")
    ('1 face', '1,200 frames')
    """
    return f"{number:,} {word}{'' if number == 1 else 's'}"


def first_line(error: BaseException) -> str:
    """First line of an error's text, or its kind when it says nothing.

    >>> first_line(ValueError("no such node\\nin graph 3")), first_line(KeyError())
    ('no such node', 'KeyError')
    """
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
