"""Damaged files of every kind that is read: a sentence or a result (`benchmarks.fuzz` reads thousands)."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks import fuzz

FILES = 12  # of each kind


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", fuzz.READERS)
@pytest.mark.slow
def test_a_damaged_file_is_read_or_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    sample = fuzz.valid(name, tmp_path)
    found = [fuzz.outcome(name, sample, seed, tmp_path) for seed in range(FILES)]
    assert not [one for one in found if one.what not in ("taken", "refused")]
    assert all("\n" not in one.details for one in found)


def test_files_are_really_damaged_and_always_in_the_same_way() -> None:
    data = bytes(range(256)) * 4
    made = [fuzz.damaged(data, np.random.default_rng(seed)) for seed in range(50)]
    assert made == [fuzz.damaged(data, np.random.default_rng(seed)) for seed in range(50)]
    assert sum(one != data for one in made) > 40
    assert len(set(made)) > 40


def test_an_exception_a_hang_and_a_crash_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import os
    import signal
    import time

    def read(path: Path) -> None:
        size = path.stat().st_size
        if size == 4:  # the undamaged file
            return
        {0: lambda: time.sleep(60), 1: lambda: os.kill(os.getpid(), signal.SIGKILL), 2: lambda: 1 / 0}[
            size % 3
        ]()

    def damage(data: bytes, rng: np.random.Generator) -> bytes:
        return bytes(5 + int(rng.integers(0, 3)))

    monkeypatch.setattr(fuzz, "damaged", damage)
    monkeypatch.setattr(fuzz, "SECONDS_EACH", 2)
    monkeypatch.setitem(
        fuzz.READERS, "PLY", fuzz.Reader(".ply", lambda path: path.write_bytes(b"abcd"), read)
    )
    assert {one.what for one in fuzz.outcomes("PLY", range(8))} == {"exception", "hang", "crash"}
