"""The output in the making: a piece for each segment of a video, or the pictures themselves, and then the whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from guise.app.deidentify.stages.case import Case
from guise.app.media import Frame, MediaInput, Sink, open_input, open_sink
from guise.app.media.input import VideoInput
from guise.app.media.outputs import check_free, is_animation
from guise.app.media.packets import PacketSink, assemble, read_packets
from guise.app.media.synthetic import synthetic_tags


def open_piece(case: Case, media: MediaInput, segment: int) -> Sink:
    """The sink for the frames of a segment."""
    if isinstance(media, VideoInput):
        return PacketSink(_piece(case, segment), media, case.options.encode, _made(case))
    made = _made(case)
    if made.is_dir():
        shutil.rmtree(made)
    return open_sink(made, media, case.options.encode, force=True, tags=synthetic_tags())


def read_piece(case: Case, segment: int) -> Iterator[Frame]:
    """The frames that were written, counted as in the input."""
    if not _piece(case, segment).exists():
        with open_input(_made(case)) as media:
            yield from media
        return
    for frame in read_packets(_piece(case, segment)):
        frame.index = int(np.searchsorted(case.scan.pts, frame.pts))
        yield frame


def publish(case: Case, output: Path, *, force: bool) -> None:
    """Join the pieces, sign the whole if requested, and give it its name, unless that has been done."""
    options = case.options
    if case.work.has("published.json") and not _made(case).exists():
        return
    with case.open_input() as media:
        check_free(output, media, force)
        parts = [_piece(case, k) for k in range(len(case.scan.segments))]
        if isinstance(media, VideoInput) and is_animation(_made(case), media):
            with open_sink(_made(case), media, options.encode, force=True, tags=synthetic_tags()) as sink:
                for part in parts:
                    for frame in read_packets(part):
                        sink.write(frame)
        elif isinstance(media, VideoInput):
            assemble(
                _made(case), media, parts, options.encode, tags=synthetic_tags(),
                private=not options.keep_metadata, audio=options.audio, force=True,
            )  # fmt: skip
    if options.certificate and options.key:
        from guise.app.media.provenance import sign

        sign(_made(case), options.certificate, options.key)
    case.work.save_json("published.json", list(media.problems))
    if output.is_dir():
        shutil.rmtree(output)  # a folder of pictures of an earlier run, and --force, or an empty one
    os.replace(_made(case), output)


def _piece(case: Case, segment: int) -> Path:
    return case.work.path(f"render.{segment}.packets")


def _made(case: Case) -> Path:
    """The whole output; a name without a suffix is a folder of pictures."""
    return case.work.path("output" + Path(case.manifest["output"]).suffix)
