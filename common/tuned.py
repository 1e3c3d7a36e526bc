"""Numbers with their source: each threshold says how its value was found.

    min_score: float = tuned(0.15, "score", "deidentify.leaks")  # of a box where the person was
    CELL_PIXELS: int = derived(16, "pixels", "an eighth of the 128 pixels that the network reads")

Both hand the value on and cost nothing afterwards; `python -m benchmarks.structure --numbers` reads the calls from the
code and prints the table of each room.
"""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def tuned(value: T, unit: str, benchmark: str) -> T:
    """A value found by trial.

    unit : "pixels", "seconds", "face widths"; "share" or "ratio" where there is none.
    benchmark : the one that tells a better value from a worse one: its name below `benchmarks`, as "picture.truth", or
        that of the script that fitted it, as "training.finish_face".

    >>> tuned((0.1, 0.3), "share", "picture.turned")
    (0.1, 0.3)
    """
    return value


def derived(value: T, unit: str, reason: str) -> T:
    """A value that follows from something else: a definition, a standard, a paper's equation, a network's input.

    >>> derived(112, "pixels", "the side of the recogniser's input")
    112
    """
    return value
