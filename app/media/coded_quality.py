"""How finely a video was quantised, as its decoder tells, and how finely it is coded again.

Coding what was coded before adds a second loss to the first.  With a step that is smaller by the factor 2^(4/6), as by
an H.264 quantiser that is less by 4, that loss is less than half as large (its energy goes with the step's square), and
the file is about as large as the input; where the input was coded coarsely, so much is not worth it.
"""

from __future__ import annotations

import struct
from typing import Any

import av

# Options of a decoder's context that make it tell.
TELL_QUANTISER = {"export_side_data": "venc_params"}
FINER_BY = 4  # quantiser steps, of which 6 double the error
LEAST_CRF, MOST_CRF = 15, 20
USUAL_CRF = 17  # of inputs that don't tell
_H264 = 1  # AV_VIDEO_ENC_PARAMS_H264
_HEADER = struct.Struct(
    "@IQQii"
)  # AVVideoEncParams: blocks, their offset and size, type, the frame's quantiser
_BLOCK = struct.Struct("@iiiii")  # AVVideoBlockParams: x, y, width, height, its quantiser over the frame's
_MOST_BLOCKS = 2000  # that are read


def quantiser(picture: av.VideoFrame) -> float | None:
    """The mean quantiser (0..51) of a decoded H.264 picture; None of others or where the decoder doesn't tell."""
    told: Any = picture.side_data.get("VIDEO_ENC_PARAMS")
    if told is None:
        return None
    data = bytes(told)
    if len(data) < _HEADER.size:
        return None
    count, offset, size, kind, frame = map(int, _HEADER.unpack_from(data))
    if kind != _H264:
        return None
    places = range(offset, min(offset + count * size, len(data) - _BLOCK.size + 1), size or 1)
    some = places[:: -(-len(places) // _MOST_BLOCKS) or 1]
    deltas = [int(_BLOCK.unpack_from(data, place)[4]) for place in some]
    return frame + sum(deltas) / max(len(deltas), 1)


def crf_like(quantiser: float | None) -> int:
    """The constant rate factor of x264 with which a video of such a mean quantiser is coded again."""
    if quantiser is None:
        return USUAL_CRF
    return min(max(round(quantiser) - FINER_BY, LEAST_CRF), MOST_CRF)
