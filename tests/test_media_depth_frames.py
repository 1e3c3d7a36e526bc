"""Frames of more than 8 bits, and of HDR, in memory: what isn't drawn on stays, and is shown as it would be in 8."""

from __future__ import annotations

import av
import cv2
import numpy as np
import pytest
from deep_pictures import UPRIGHT, code_of, filled, framed, stored

from guise.app.media.colour import BT709, LIMITED, yuv_matrix
from guise.app.media.deep_frame import DeepFrame
from guise.app.media.frame import plane_arrays
from guise.app.media.orientation import Orientation
from guise.app.media.pixel_formats import DEEP_FORMATS
from guise.app.media.rendition import HLG, PQ, WHITE_NITS, rendition_of
from guise.app.swapping.cover import cover

ORIENTATIONS = [UPRIGHT, Orientation(transpose=True, flip_x=True)]


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("transfer", [BT709, PQ, HLG])
@pytest.mark.parametrize("fmt", DEEP_FORMATS)
def test_only_what_is_drawn_changes(fmt: str, transfer: int, orientation: Orientation) -> None:
    frame = framed(filled(fmt, transfer=transfer), orientation)
    assert isinstance(frame, DeepFrame)
    before, whole = stored(frame), frame.read_roi(0, 0, frame.width, frame.height)
    frame.write_roi(0, 0, whole)
    frame.write_roi(2, 3, frame.read_roi(2, 3, 5, 4))  # cuts chroma cells
    for old, new in zip(before, stored(frame), strict=True):
        np.testing.assert_array_equal(old, new)
    x, y, w, h = frame.align_roi(6, 5, 15, 13)
    drawn = np.full((h, w, 3), (90, 120, 135), np.uint8)
    drawn[..., 0] += np.arange(w, dtype=np.uint8)
    frame.write_roi(x, y, drawn)
    shown = frame.read_roi(0, 0, frame.width, frame.height)
    colours = 1 if fmt.startswith("gray") else 3
    gap = np.abs(shown[y : y + h, x : x + w].astype(int) - drawn)[..., :colours]
    assert gap.max() <= (1 if transfer == BT709 or colours == 1 else 3)
    inside = np.zeros(whole.shape[:2], bool)
    inside[y : y + h, x : x + w] = True
    np.testing.assert_array_equal(shown[~inside], whole[~inside])
    np.testing.assert_array_equal(
        frame.luma[~inside], framed(filled(fmt, transfer=transfer), orientation).luma[~inside]
    )
    if fmt.startswith("yuva"):
        np.testing.assert_array_equal(before[3], stored(frame)[3])


@pytest.mark.parametrize("transfer", [BT709, PQ, HLG])
def test_a_small_change_of_one_pixel_leaves_its_neighbours_alone(transfer: int) -> None:
    frame = framed(filled("yuv420p10le", transfer=transfer))
    before, roi = stored(frame), frame.read_roi(8, 8, 8, 8)
    roi[3, 2, 0] += 9
    frame.write_roi(8, 8, roi)
    changed = [np.argwhere(old != new).tolist() for old, new in zip(before, stored(frame), strict=True)]
    assert changed[0] == [[11, 10]]
    assert all(where in ([], [[5, 5]]) for where in changed[1:])


@pytest.mark.parametrize("transfer", [PQ, HLG])
@pytest.mark.parametrize("fmt", ["yuv420p", "nv12", "yuva444p"])
def test_hdr_of_8_bits_is_drawn_on_as_hdr(fmt: str, transfer: int) -> None:
    frame = framed(filled(fmt, transfer=transfer))
    before, roi = stored(frame), frame.read_roi(4, 4, 16, 16)
    deep = framed(filled("yuv444p16le", transfer=transfer)).read_roi(4, 4, 16, 16)
    assert np.abs(roi[..., 0].astype(int) - deep[..., 0]).mean() < 4
    frame.write_roi(4, 4, roi)
    for old, new in zip(before, stored(frame), strict=True):
        np.testing.assert_array_equal(old, new)
    frame.write_roi(4, 4, np.full((16, 16, 3), (120, 120, 135), np.uint8))
    assert np.abs(frame.read_roi(4, 4, 16, 16) - np.array([120.0, 120, 135])).max() < 5


@pytest.mark.parametrize("transfer", [BT709, PQ, HLG])
def test_nothing_of_a_covered_face_remains_in_the_last_bits(transfer: int) -> None:
    planes = []
    for seed in (1, 2):
        frame = framed(filled("yuv420p10le", seed, 64, 64, transfer))
        cover(frame, np.array([10.0, 10.0, 54.0, 54.0]), "solid")
        planes.append(
            [
                plane[20 // k : 44 // k, 20 // k : 44 // k]
                for plane, k in zip(stored(frame), (1, 2, 2), strict=True)
            ]
        )
    for first, second in zip(*planes, strict=True):
        np.testing.assert_array_equal(first, second)
        assert np.ptp(first) == 0


def test_shown_like_the_same_picture_of_8_bits() -> None:
    deep, video = framed(filled("yuv420p12le")), av.VideoFrame(37, 23, "yuv420p")
    for shallow, plane in zip(plane_arrays(video), stored(deep), strict=True):
        shallow[:] = (plane + 8) >> 4
    video.colorspace, video.color_range = 9, LIMITED
    plain = framed(video)
    np.testing.assert_array_equal(deep.luma, plain.luma)
    np.testing.assert_array_equal(deep.rgb(), plain.rgb())
    np.testing.assert_array_equal(deep.copy().read_roi(3, 4, 9, 7), plain.read_roi(3, 4, 9, 7))
    points = np.random.default_rng(0).uniform(2, 20, (50, 2))
    assert np.abs(deep.sample_rgb(points) - plain.sample_rgb(points)).max() < 1.5
    assert np.abs(deep.quick_rgb().astype(int) - plain.quick_rgb()).mean() < 1.5
    deep.show(np.full((5, 7, 3), 9, np.uint8))
    assert deep.luma.shape == deep.copy().luma.shape == (5, 7)


# -- HDR -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_hdr_is_shown_as_sdr_would_show_it(transfer: int) -> None:
    matrix = yuv_matrix(9, LIMITED, 1080)
    look = rendition_of(matrix, transfer, 9)
    nits = np.array([0, 1, 5, 20, 50, 100, WHITE_NITS, 400, 1000], np.float64)
    grey = np.full((len(nits), 1, 3), 128, np.float32)
    grey[:, 0, 0] = 16 + 219 * code_of(nits, transfer)
    shown = (look.shown(grey)[:, 0, 0] - 16) / 219
    np.testing.assert_allclose(shown[:6], (nits[:6] / WHITE_NITS) ** (1 / 2.2), atol=0.004)
    assert (np.diff(shown) > 0.005).all()
    assert 0.85 < shown[6] < 0.95
    assert shown[-1] < 1
    np.testing.assert_allclose(look.stored(look.shown(grey)), grey, atol=0.15)


def test_wide_colours_are_shown_as_those_of_bt709() -> None:
    rgb = np.array([[[0.5, 0.3, 0.2]], [[0.1, 0.4, 0.7]]])  # light in BT.709, of 100 nits
    mixed = rgb @ np.array([[0.6274, 0.0691, 0.0164], [0.3293, 0.9195, 0.0880], [0.0433, 0.0114, 0.8956]])
    matrix = yuv_matrix(9, LIMITED, 1080)
    stored = cv2.transform((255 * code_of(100 * mixed, PQ)).astype(np.float32), matrix.from_rgb)
    shown = cv2.transform(rendition_of(matrix, PQ, 9).shown(stored), matrix.to_rgb)
    np.testing.assert_allclose(shown / 255, (100 / WHITE_NITS * rgb) ** (1 / 2.2), atol=0.01)
    quick = rendition_of(matrix, PQ, 9).quick((255 * code_of(100 * mixed, PQ)).round().astype(np.uint8))
    assert np.abs(quick / 255 - (100 / WHITE_NITS * rgb) ** (1 / 2.2)).max() < 0.06
