"""The command `guise deidentify` for the benchmarks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.children import GUISE, Ran, ffmpeg, looped, ran

LOSSLESS_OPTIONS = ("--lossless", "--encoder-preset", "ultrafast")
NOT_VERIFIED = 3
CLIP = "room_s18"


def enlarged(shared: Path, folder: Path, clip: str = CLIP) -> Path:
    """A real clip enlarged to 1920 x 1080, without sound."""
    large, video = folder / "large.mp4", shared / "data" / "real" / f"{clip}.mp4"
    ran(ffmpeg("-i", video, "-vf", "scale=1920:1080", "-preset", "ultrafast", "-crf", "23", "-an", large))
    return large


def long_clip(large: Path, minutes: float) -> Path:
    """A clip repeated to a length, beside it."""
    return looped(large, 60 * minutes, large.with_name(f"long{minutes:g}.mp4"))


def guise_command(video: Path, output: Path, *more: str) -> list[str | Path]:
    """A command with default options and `more`."""
    return [*GUISE, "deidentify", video, "-o", output, "--quiet", *more]


def deidentified(video: Path, output: Path, *more: str) -> dict[str, Any]:
    """Run it; returns its report.  That some faces are only covered is no failure."""
    done(guise_command(video, output, *more))
    return dict(json.loads(output.with_name(f"{output.stem}.report.json").read_text(encoding="utf-8")))


def done(command: list[str | Path], sample_every: float | None = None) -> Ran:
    """Run a command of which some faces may only be covered."""
    return ran(command, sample_every, allowed=(0, NOT_VERIFIED))
