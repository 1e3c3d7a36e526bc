"""One frame, everything: from a decoded 720p frame to the swapped one, with software GL and with the CPU renderer.

Timed is `Engine.step` alone: tracking, sampling, transfer, palette, warp, blending, and reading and writing the face's
rectangle in the frame's YUV planes.  Passes over the clip alternate between the renderers; the first pass of each and
the first frames of every pass (detection, first use) are left out.  Frames are decoded in short runs beforehand, so
that the decoder's threads do not work meanwhile; matrix work has one thread, as in the commands.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Report, Table
from guise.aam.model import Identity
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import SWAP
from guise.app.media import Frame, open_input
from guise.common.threads import one_thread
from guise.render.compositor import Renderer

CLIP, DONOR = "room_s18", "studio_d7"
RENDERERS: tuple[Renderer, ...] = ("gl", "cpu")
PASSES = 5
DECODED_AHEAD = 40  # frames decoded ahead
WARM_UP_FRAMES = 5


def in_runs(video: Path) -> Iterator[Frame]:
    """Every frame, decoded some at a time."""
    with open_input(video) as source:
        frames = iter(source)
        while run := list(islice(frames, DECODED_AHEAD)):
            while run:
                yield run.pop(0)


def times(clip: Clip, source: Identity, donor: Identity, renderer: Renderer) -> tuple[F64, str]:
    """Milliseconds of every frame that was swapped, and who drew."""
    taken = []
    with one_thread(), Engine(source, donor, common.detector(), replace(SWAP, renderer=renderer)) as engine:
        for frame in in_runs(clip.video):
            start = time.perf_counter()
            result = engine.swap(frame)
            seconds = time.perf_counter() - start
            if result.outcome == "swapped":
                taken.append(1e3 * seconds)
        return np.array(taken[WARM_UP_FRAMES:]), engine.renderer


def measure(options: argparse.Namespace) -> Report:
    """Alternating passes."""
    clip, donor_clip = (common.real_clip(options.shared, name) for name in (CLIP, DONOR))
    source, donor = common.enrolled(clip), common.enrolled(donor_clip)
    taken: dict[Renderer, list[F64]] = {r: [] for r in RENDERERS}
    drawn: dict[Renderer, str] = {}
    for _ in range(2 if options.quick else PASSES + 1):
        for renderer in RENDERERS:
            found, drawn[renderer] = times(clip, source, donor, renderer)
            taken[renderer].append(found)
    pooled = {r: np.concatenate(taken[r][1:]) for r in RENDERERS}
    rows = [
        (r, drawn[r], float(np.median(v)), float(np.quantile(v, 0.95)), float(np.quantile(v, 0.99)), len(v))
        for r, v in pooled.items()
    ]
    columns = ("renderer", "who draws", "median, ms", "95th percentile, ms", "99th percentile, ms", "frames")
    width = float(np.ptp(clip.points[:, :, 0], axis=1).mean())
    return Report(
        "frame_time",
        "One frame, everything, 720p",
        [
            Criterion(f"{r}, {what}", float(value(pooled[r])), "<=", target, "ms")
            for r in RENDERERS
            for what, value, target in (
                ("median", np.median, 10.0),
                ("95th percentile", lambda v: np.quantile(v, 0.95), 16.0),
            )
        ],
        [
            Table(
                f"Frames of {CLIP} with the face of {DONOR}; the face is {width:.0f} pixels wide",
                columns,
                rows,
            )
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
