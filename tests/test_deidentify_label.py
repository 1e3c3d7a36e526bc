"""The visible label: readable on any ground, and nothing outside it changes."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_media import STEADY, make_clip

from guise.app.deidentify.stages.label import Label
from guise.app.media import Frame, open_input


def changed(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rectangle that differs, as x0 y0 x1 y1."""
    rows, columns = np.nonzero((before != after).any(axis=-1))
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])


@pytest.mark.parametrize("size", [(1920, 1080), (1280, 720), (720, 1280), (400, 300), (161, 121)])
@pytest.mark.parametrize("ground", [0, 128, 255])
def test_it_is_small_in_the_corner_and_has_contrast(size: tuple[int, int], ground: int) -> None:
    width, height = size
    frame = Frame.from_rgb(np.full((height, width, 3), ground, np.uint8))
    before = frame.rgb()
    Label(width, height).draw(frame)
    x0, y0, x1, y1 = changed(before, frame.rgb())
    assert x1 - x0 < 0.6 * width or width < 200
    assert 7 <= y1 - y0 < 0.2 * height
    assert height - y1 < 0.1 * height
    plate = frame.rgb()[y0:y1, x0:x1].mean(axis=2)
    assert 0.03 < (plate > 160).mean() < 0.4
    assert (plate < 110).mean() > 0.4


def test_only_its_rectangle_changes_and_all_pixel_formats_work(tmp_path: Path) -> None:
    for fmt in ("yuv420p", "yuv422p", "yuv444p", "gray"):
        clip = make_clip(
            tmp_path / f"{fmt}.mkv",
            STEADY[:2],
            size=(322, 182),
            fmt=fmt,
            encoder="ffv1",
            clock=Fraction(1, 1000),
        )
        with open_input(clip) as source:
            for frame in source:
                before = frame.read_roi(0, 0, frame.width, frame.height)
                Label(frame.width, frame.height).draw(frame)
                after = frame.read_roi(0, 0, frame.width, frame.height)
                x0, y0, x1, y1 = changed(before, after)
                assert x1 - x0 < 0.9 * frame.width
                assert y1 - y0 < 0.15 * frame.height
                assert y0 > 0.8 * frame.height


def test_it_stands_upright_in_a_turned_video(tmp_path: Path) -> None:
    clip = make_clip(
        tmp_path / "in.mp4", STEADY[:2], size=(320, 240), adjust=lambda video: video.set_display_rotation(90)
    )
    with open_input(clip) as source:
        frame = next(iter(source))
        straight = Frame.from_rgb(np.full((320, 240, 3), 128, np.uint8))
        before = frame.rgb()
        for one in (frame, straight):
            Label(240, 320).draw(one)
        where = changed(before, frame.rgb())
        np.testing.assert_allclose(where, changed(np.full((320, 240, 3), 128), straight.rgb()), atol=2)
        ink = cv2.cvtColor(straight.rgb(), cv2.COLOR_RGB2GRAY) > 240
        assert cv2.cvtColor(frame.rgb(), cv2.COLOR_RGB2GRAY)[ink].min() > 225
