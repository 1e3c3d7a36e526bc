"""A video frame that stays in the decoder's planes; only rectangles of it are converted.

Pixels, x right, y down, pixel centres at integers, display orientation (after the container's rotation).
Components are 8-bit Y, U, V, or G, B, R for RGB pictures (`guise.app.media.colour`); chroma may be halved along
either axis.  Alpha that a decoded picture has stays as it is.  Pictures with more bits are frames too, see
`deep_frame.py`, where `frame_of` makes either.  A frame is used by one thread at a time.
"""

from __future__ import annotations

import math
import threading
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import av
import cv2
import numpy as np
from av.video.plane import VideoPlane
from av.video.reformatter import VideoReformatter
from numpy.typing import ArrayLike, NDArray

from guise.app.media import colour as tags
from guise.app.media.colour import ColourMatrix, gbr_matrix, yuv_matrix
from guise.app.media.orientation import AS_STORED, Orientation, Points
from guise.app.media.pixel_formats import DEEP_FORMATS, NATIVE_FORMATS, SHALLOW, depth, has_alpha
from guise.common.arrays import side_by_side
from guise.common.kernels import kernel
from guise.common.sampling import remap_points

if TYPE_CHECKING:
    from guise.app.media.images import DeepImage

__all__ = ["ColourMatrix", "Frame", "clone_video_frame", "from_planes", "plane_arrays"]

Plane = NDArray[np.uint8]


class _Scalers(threading.local):
    """FFmpeg's scalers of a thread: to make one ready takes as long as a picture, and it starts threads."""

    def __init__(self) -> None:
        self.whole, self.small = VideoReformatter(), VideoReformatter()


_SCALERS = _Scalers()


class Frame:
    """One picture with its time; made by an input or by `from_rgb`.

    pts, time_base : the integer time stamp and its unit, seconds.
    duration : until the next frame, in units of time_base; 0 if unknown.
    index : number of frames before this one in its input.
    name : file name of an image, or None.   stored : that image as its file holds it, or None.
    width, height : pixels, as shown.
    colour : maps between the stored components and RGB.
    """

    def __init__(
        self, picture: av.VideoFrame | Plane, *, pts: int, time_base: Fraction, index: int,
        orientation: Orientation = AS_STORED, name: str | None = None, alpha: Plane | None = None,
    ) -> None:  # fmt: skip
        self.pts, self.time_base, self.index, self.name = pts, time_base, index, name
        self.alpha = alpha
        self.stored: DeepImage | None = None
        self.orientation = orientation
        self._video = picture if isinstance(picture, av.VideoFrame) else None
        self._rgb = None if isinstance(picture, av.VideoFrame) else picture
        self._planes: tuple[Plane, ...] | None = None
        self._shown: tuple[Plane, ...] | None = None
        self._luma: Plane | None = None
        if isinstance(picture, av.VideoFrame):
            stored, self.duration = (picture.width, picture.height), picture.duration or 0
            self._shift = NATIVE_FORMATS[picture.format.name]
            self.colour = matrix_of(picture)
        else:
            stored, self.duration = (picture.shape[1], picture.shape[0]), 0
            self._shift, self.colour = (0, 0), _GBR
        self.width, self.height = orientation.size(*stored)
        self._stored_shift = self._shift
        if orientation.transpose:
            self._shift = (self._shift[1], self._shift[0])
        self._grids = self._grid(0), self._grid(1)

    @classmethod
    def from_rgb(
        cls, rgb: Plane, pts: int = 0, time_base: Fraction = Fraction(1, 30), index: int = 0,
        *, name: str | None = None, alpha: Plane | None = None,
    ) -> Frame:  # fmt: skip
        """A frame holding a copy of an RGB picture.

        rgb : (h, w, 3) uint8.   alpha : (h, w) uint8 or None, carried to image files unchanged.
        """
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise ValueError(f"rgb must be (h, w, 3) uint8, got {rgb.shape} {rgb.dtype}")
        own = np.array(rgb, dtype=np.uint8, order="C", copy=True)
        return cls(own, pts=pts, time_base=time_base, index=index, name=name, alpha=alpha)

    def show(self, rgb: Plane) -> None:
        """Hold a copy of another picture (h, w, 3) uint8 RGB, of any size, with the same time, index and name."""
        shown = Frame.from_rgb(rgb, self.pts, self.time_base, self.index, name=self.name)
        shown.duration = self.duration
        vars(self).update(vars(shown))

    @property
    def seconds(self) -> float:
        """The time at which the frame is shown."""
        numerator, denominator = self.time_base.as_integer_ratio()  # sooner than the product of fractions
        return self.pts * numerator / denominator

    @property
    def video_frame(self) -> av.VideoFrame | None:
        """The decoder's frame, as stored, for an encoder; None for an RGB picture."""
        return self._video

    @property
    def luma(self) -> Plane:
        """(h, w) uint8 brightness as stored, read-only; a view of the decoder's plane unless it is turned."""
        if self._luma is None:
            self._luma = self._make_luma()
            self._luma.setflags(write=False)
        return self._luma

    def _make_luma(self) -> Plane:
        if self._rgb is not None:
            shown = self.orientation.view(self._rgb)
            return np.asarray(cv2.cvtColor(np.ascontiguousarray(shown), cv2.COLOR_RGB2GRAY), np.uint8)
        luma = self._shown_planes()[0]
        return luma[:] if self.orientation.is_identity else luma.copy()

    def opacity(self) -> Plane | None:
        """(h, w) uint8 as shown: an image's alpha, or that of a decoded picture; None without."""
        if self.alpha is not None or self._video is None or not has_alpha(self._video.format.name):
            return self.alpha
        stored = self.orientation.view(plane_arrays(self._video)[-1])
        return (stored >> (depth(self._video.format.name) - SHALLOW)).astype(np.uint8)

    def _stored_planes(self) -> tuple[Plane, ...]:
        """Component planes of a decoded frame as stored, writable, and never shared with the decoder."""
        if self._planes is None:
            assert self._video is not None
            # Before the first view, as a later copy would invalidate the views.
            self._video.make_writable()
            self._planes = plane_arrays(self._video)[:3]
        return self._planes

    def _shown_planes(self) -> tuple[Plane, ...]:
        if self._shown is None:
            self._shown = tuple(self.orientation.view(plane) for plane in self._stored_planes())
        return self._shown

    # -- the chroma grid along one shown axis -------------------------------------------------------------

    def _grid(self, axis: int) -> tuple[int, int, int]:
        """Length in pixels, log2 of the chroma step, and pixels missing before the first chroma sample.

        A mirrored picture of odd length starts with the incomplete chroma cell that it used to end with.
        """
        length, shift = (self.width, self.height)[axis], self._shift[axis]
        flipped = (self.orientation.flip_x, self.orientation.flip_y)[axis]
        return length, shift, (-length) % (1 << shift) if flipped else 0

    def _align_axis(self, low: float, high: float, axis: int) -> tuple[int, int]:
        """The smallest clipped interval on the chroma grid over [low, high); returns start and length."""
        length, shift, offset = self._grids[axis]
        first = min(max(math.floor(low), 0), length)
        last = min(max(math.ceil(high), first), length)
        start = max((((first + offset) >> shift) << shift) - offset, 0)
        return start, min((-((-last - offset) >> shift) << shift) - offset, length) - start

    def _cells(self, start: int, length: int, axis: int) -> tuple[int, int, int]:
        """Chroma samples [first, last) over an interval, and pixels of the first one before it."""
        _, shift, offset = self._grids[axis]
        first = (start + offset) >> shift
        last = ((start + length - 1 + offset) >> shift) + 1
        return first, last, start + offset - (first << shift)

    def align_roi(self, x0: float, y0: float, x1: float, y1: float) -> tuple[int, int, int, int]:
        """The rectangle [x0, x1) x [y0, y1) clipped to the picture and grown to the chroma grid.

        Returns (x0, y0, w, h), pixels; w or h is 0 when nothing is left.

        >>> Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)).align_roi(-3, 1.5, 4, 20)
        (0, 1, 4, 7)
        """
        x, width = self._align_axis(x0, x1, 0)
        y, height = self._align_axis(y0, y1, 1)
        return x, y, width, height

    def _check(self, x0: int, y0: int, width: int, height: int) -> None:
        inside = x0 >= 0 and y0 >= 0 and x0 + width <= self.width and y0 + height <= self.height
        if not inside or width < 1 or height < 1:
            raise ValueError(
                f"rectangle must lie in the {self.width} x {self.height} picture, "
                f"got x {x0}, y {y0}, width {width}, height {height}"
            )

    # -- rectangles ---------------------------------------------------------------------------------------

    def read_roi(self, x0: int, y0: int, w: int, h: int) -> Plane:
        """A copy of a rectangle: (h, w, 3) uint8 components at full resolution, chroma replicated."""
        self._check(x0, y0, w, h)
        if self._rgb is not None:
            shown = self.orientation.view(self._rgb)[y0 : y0 + h, x0 : x0 + w]
            gbr = np.empty((h, w, 3), np.uint8)  # three copies of planes: many times faster than an index
            gbr[..., 0], gbr[..., 1], gbr[..., 2] = shown[..., 1], shown[..., 2], shown[..., 0]
            return gbr
        luma, *chroma = self._shown_planes()
        made = np.empty((h, w, 3), np.uint8)
        if not chroma:
            made[..., 0], made[..., 1:] = luma[y0 : y0 + h, x0 : x0 + w], 128
            return made
        (cx0, cx1, left), (cy0, cy1, top) = self._cells(x0, w, 0), self._cells(y0, h, 1)
        u, v = (plane[cy0:cy1, cx0:cx1] for plane in chroma)
        merge_planes(luma[y0 : y0 + h, x0 : x0 + w], u, v, *self._shift, left, top, made)
        return made

    def write_roi(self, x0: int, y0: int, yuv: Plane, hidden: Plane | None = None) -> None:
        """Write a rectangle of components back in place.

        yuv : (h, w, 3) uint8.   hidden : (h, w), not 0 where nothing of what was there may remain, not even bits of a
        deeper picture that 8 bits don't show.  A chroma sample becomes the rounded mean of its pixels, so that what
        `read_roi` gave is written back bit-identical.  Best with a rectangle from `align_roi`: one that
        cuts a chroma cell is completed from the picture.
        """
        if yuv.ndim != 3 or yuv.shape[2] != 3 or yuv.dtype != np.uint8:
            raise ValueError(f"yuv must be (h, w, 3) uint8, got {yuv.shape} {yuv.dtype}")
        h, w = yuv.shape[:2]
        self._check(x0, y0, w, h)
        self._luma = None
        if self._rgb is not None:
            shown = self.orientation.view(self._rgb)[y0 : y0 + h, x0 : x0 + w]
            shown[..., 1], shown[..., 2], shown[..., 0] = yuv[..., 0], yuv[..., 1], yuv[..., 2]
            return
        aligned = self.align_roi(x0, y0, x0 + w, y0 + h)
        if aligned != (x0, y0, w, h):
            whole = self.read_roi(*aligned)
            whole[y0 - aligned[1] :, x0 - aligned[0] :][:h, :w] = yuv
            (x0, y0, w, h), yuv = aligned, whole
        for number, (plane, part) in enumerate(zip(self._shown_planes(), cv2.split(yuv), strict=False)):
            self._write_plane(plane, np.asarray(part, np.uint8), x0, y0, is_chroma=number > 0)

    def _write_plane(self, plane: Plane, part: Plane, x0: int, y0: int, *, is_chroma: bool) -> None:
        h, w = part.shape
        if not is_chroma or self._shift == (0, 0):
            plane[y0 : y0 + h, x0 : x0 + w] = part
            return
        cx0, cx1, left = self._cells(x0, w, 0)
        cy0, cy1, top = self._cells(y0, h, 1)
        right = ((cx1 - cx0) << self._shift[0]) - left - w
        bottom = ((cy1 - cy0) << self._shift[1]) - top - h
        if left or right or top or bottom:
            part = np.asarray(
                cv2.copyMakeBorder(part, top, bottom, left, right, cv2.BORDER_REPLICATE), np.uint8
            )
        plane[cy0:cy1, cx0:cx1] = cv2.resize(part, (cx1 - cx0, cy1 - cy0), interpolation=cv2.INTER_AREA)

    @property
    def yuv(self) -> ColourMatrix:
        """As `colour`, but of brightness and chroma of an RGB picture, too."""
        return self.colour if self._rgb is None else _YUV

    def read_yuv(self, x0: int, y0: int, w: int, h: int) -> Plane:
        """As `read_roi`, in the components of `yuv`."""
        if self._rgb is None:
            return self.read_roi(x0, y0, w, h)
        return np.asarray(cv2.transform(self.rgb_roi(x0, y0, w, h), _YUV.from_rgb), np.uint8)

    def write_yuv(self, x0: int, y0: int, yuv: Plane) -> None:
        """Write back what `read_yuv` gave; what is not changed stays bit-identical."""
        if self._rgb is None:
            self.write_roi(x0, y0, yuv)
            return
        h, w = yuv.shape[:2]
        changed = (yuv != self.read_yuv(x0, y0, w, h)).any(2, keepdims=True)
        rgb = np.where(changed, cv2.transform(yuv, _YUV.to_rgb), self.rgb_roi(x0, y0, w, h))
        self.write_roi(x0, y0, np.asarray(rgb[..., [1, 2, 0]], np.uint8))

    def rgb_roi(self, x0: int, y0: int, w: int, h: int) -> Plane:
        """A copy of a rectangle as RGB, (h, w, 3) uint8, full range."""
        self._check(x0, y0, w, h)
        if self._rgb is not None:
            return np.array(self.orientation.view(self._rgb)[y0 : y0 + h, x0 : x0 + w], order="C")
        return np.asarray(cv2.transform(self.read_roi(x0, y0, w, h), self.colour.to_rgb), np.uint8)

    def shown_planes(self) -> tuple[Plane, Plane, Plane, NDArray[np.float64]] | None:
        """Brightness and chroma (h, w) of 8 bits, and from pixels to chroma's: scales, then what is taken off before.

        None if the picture has no such planes: RGB, and deeper ones.
        """
        if self._rgb is not None:
            return None
        luma, *chroma = (side_by_side(plane) for plane in self._shown_planes())
        first, second = chroma or (_GREY, _GREY)
        steps = [1 << shift for shift in self._shift]
        before = [(step - 1) / 2 - self._grids[axis][2] for axis, step in enumerate(steps)]
        return luma, first, second, np.array([1 / steps[0], 1 / steps[1], *before])

    def rgb(self) -> Plane:
        """A copy of the whole picture as RGB, (height, width, 3) uint8; too slow for every frame of a video."""
        return self.rgb_roi(0, 0, self.width, self.height)

    def quick_rgb(self) -> Plane:
        """As `rgb`, by FFmpeg's scaler: many times faster, a few grey levels off; for viewing whole pictures."""
        if self._video is None or not self.orientation.is_identity:
            return self.rgb()
        return np.asarray(
            _SCALERS.whole.reformat(self._video, format="rgb24", threads=1).to_ndarray(), np.uint8
        )

    def scaled_rgb(self, width: int, height: int) -> Plane:
        """As `quick_rgb`, at another size, by the means of the pixels."""
        if not self._as_stored:
            return np.asarray(cv2.resize(self.rgb(), (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        assert self._video is not None
        scaled = _SCALERS.small.reformat(self._video, width, height, "rgb24", interpolation="AREA", threads=1)
        return np.asarray(scaled.to_ndarray(), np.uint8)

    @property
    def _as_stored(self) -> bool:
        """Whether the decoder's picture is shown as it is stored."""
        return self._video is not None and self.orientation.is_identity

    # -- points -------------------------------------------------------------------------------------------

    def sample_rgb(self, points: ArrayLike) -> NDArray[np.float32]:
        """Bilinear RGB at points of the picture; the border is repeated outside it.

        points : (n, 2) float, pixels, finite.   Returns (n, 3) float32, not clipped to 0..255.
        """
        shown = np.asarray(points, np.float32)
        if shown.ndim != 2 or shown.shape[1] != 2 or not np.isfinite(shown).all():
            raise ValueError(f"points must be (n, 2) and finite, got {shown.shape}")
        if len(shown) == 0:
            return np.zeros((0, 3), np.float32)
        stored = self.orientation.stored_points(shown, self.width, self.height)
        return self._colours_at(np.ascontiguousarray(stored, np.float32))

    def _colours_at(self, points: Points) -> NDArray[np.float32]:
        """RGB (n, 3) at stored points (n, 2)."""
        made = np.empty((len(points), 3), np.float32)
        if self._rgb is not None:
            sample_picture(self._rgb, points, made)
            return made
        luma, *chroma = self._stored_planes()
        first, second = chroma or (_GREY, _GREY)
        sample_planes(luma, first, second, points, self._to_chroma, self.colour.to_rgb, made)
        return made

    @property
    def _to_chroma(self) -> NDArray[np.float32]:
        """See `sample_planes`: chroma samples are centred on their cells, but in MPEG on even columns."""
        x, y = 1 << self._stored_shift[0], 1 << self._stored_shift[1]
        mpeg = self._video is not None and not self._video.format.name.startswith("yuvj")
        return np.array([1 / x, 1 / y, 0 if mpeg else (x - 1) / 2, (y - 1) / 2], np.float32)

    @property
    def nbytes(self) -> int:
        """Bytes of the picture as stored."""
        planes = self._stored_planes() if self._rgb is None else (self._rgb,)
        return sum(plane.nbytes for plane in planes)

    def copy(self) -> Frame:
        """An independent copy of the picture with the same time."""
        picture = clone_video_frame(self._video) if self._video is not None else self._rgb
        assert picture is not None
        kind = Frame if self._video is None else type(self)
        twin = kind(
            picture if isinstance(picture, av.VideoFrame) else picture.copy(), pts=self.pts, index=self.index,
            time_base=self.time_base, orientation=self.orientation, name=self.name, alpha=self.alpha,
        )  # fmt: skip
        twin.duration, twin.stored = self.duration, self.stored
        return twin


_GREY: Plane = np.full((1, 1), 128, np.uint8)
_GBR = gbr_matrix()
_YUV = yuv_matrix(tags.BT470BG, tags.FULL, 0)
_MATRICES: dict[tuple[int, int, bool], ColourMatrix] = {}


def matrix_of(video: av.VideoFrame) -> ColourMatrix:
    """The colour matrix of a decoded frame, made once per set of tags."""
    colour_range = video.color_range
    name = video.format.name
    if name.startswith("yuvj") or (name.startswith("gray") and colour_range != tags.LIMITED):
        colour_range = tags.FULL
    key = (int(video.colorspace), int(colour_range), video.height >= 720)
    if key not in _MATRICES:
        _MATRICES[key] = yuv_matrix(key[0], key[1], video.height)
    return _MATRICES[key]


def plane_arrays(video: av.VideoFrame) -> tuple[NDArray[Any], ...]:
    """Views (h, w) uint8, or uint16 of a deep format, of a native frame's planes as stored; alpha is the last."""
    planes = video.planes
    rows = [_plane_rows(plane) for plane in planes]
    if video.format.name in DEEP_FORMATS:
        return tuple(
            row[:, : 2 * plane.width].view(np.uint16) for row, plane in zip(rows, planes, strict=True)
        )
    if video.format.name == "nv12":
        width = planes[1].width
        return rows[0][:, : video.width], rows[1][:, : 2 * width : 2], rows[1][:, 1 : 2 * width : 2]
    return tuple([row[:, : plane.width] for row, plane in zip(rows, planes, strict=True)])


def is_transparent(video: av.VideoFrame) -> bool:
    """Whether any pixel of a native frame is not opaque."""
    if not has_alpha(video.format.name):
        return False
    alpha = plane_arrays(video)[-1]
    return bool(alpha.min() < (1 << depth(video.format.name)) - 1)


def from_planes(data: Plane, width: int, height: int, fmt: str) -> av.VideoFrame:
    """A frame of an 8-bit format, from the bytes (n,) of its planes one after the other, rows without padding.

    ValueError when there are not enough.
    """
    video, start = av.VideoFrame(width, height, fmt), 0
    for number, plane in enumerate(video.planes):
        step = plane.width * _sample_bytes(fmt, number)
        part = data[start : start + plane.height * step]
        if len(part) < plane.height * step:
            raise ValueError(f"{width} x {height} {fmt} needs more than {len(data)} bytes")
        _plane_rows(plane)[:, :step] = part.reshape(plane.height, step)
        start += len(part)
    return video


def _sample_bytes(fmt: str, number: int) -> int:
    """Bytes of a sample of a plane, of all components that it holds."""
    return {"nv12": 1 + number, "rgba": 4, "bgra": 4}.get(fmt, 1)


def _plane_rows(plane: VideoPlane) -> Plane:
    """(h, bytes a line) view of one plane, padding included."""
    stride = plane.line_size
    rows: Plane = np.frombuffer(plane, np.uint8).reshape(plane.height, -1)  # type: ignore[call-overload]
    return rows[::-1] if stride < 0 else rows


def clone_video_frame(video: av.VideoFrame, width: int = 0, height: int = 0, fmt: str = "") -> av.VideoFrame:
    """A copy of a native frame; a larger size repeats the last row and column.

    `fmt` may be another name for the same planes (yuvj420p, yuv420p).
    """
    twin = av.VideoFrame(width or video.width, height or video.height, fmt or video.format.name)
    for target, plane in zip(plane_arrays(twin), plane_arrays(video), strict=True):
        rows, columns = plane.shape
        target[:rows, :columns] = plane
        target[:rows, columns:] = plane[:, -1:]
        target[rows:] = target[rows - 1]
    twin.pts, twin.duration = video.pts, video.duration
    if video.time_base is not None:
        twin.time_base = video.time_base
    twin.colorspace, twin.color_range = video.colorspace, video.color_range
    twin.color_trc, twin.color_primaries = video.color_trc, video.color_primaries
    return twin


@kernel
def merge_planes(
    luma: Plane, u: Plane, v: Plane, shift_x: int, shift_y: int, left: int, top: int, out: Plane
) -> None:
    """Components (h, w, 3) of planes, luma (h, w) and chroma of cells of 2^shift pixels, which is repeated.

    left, top : pixels of the first cells before those of luma.
    """
    h, w = luma.shape
    chroma = (
        c.repeat(1 << shift_x, 1).repeat(1 << shift_y, 0)[top : top + h, left : left + w] for c in (u, v)
    )
    out[..., 0], out[..., 1], out[..., 2] = luma, *chroma


@kernel
def sample_picture(picture: Plane, points: Points, colours: NDArray[np.float32]) -> None:
    """Bilinear colours (n, c) of a picture (h, w, c) at points (n, 2); the border is repeated beyond it."""
    colours[:] = _bilinear(points, picture)[0]


@kernel
def sample_planes(
    luma: Plane, first: Plane, second: Plane, points: Points, to_chroma: NDArray[np.float32],
    to_rgb: NDArray[np.float32], colours: NDArray[np.float32],
) -> None:  # fmt: skip
    """Bilinear RGB at points of a picture in planes; the border is repeated beyond it.

    Parameters
    ----------
    luma, first, second : (h, w), and (h', w') both of chroma.
    points : (n, 2), pixels.
    to_chroma : (4,) scale along x and y, and corner: a point is seen at (point - corner) * scale in chroma.
    to_rgb : (3, 4), see `ColourMatrix`.
    colours : (n, 3), not clipped, which is written.
    """
    values = components_at((luma, first, second), points, to_chroma)
    colours[:] = cv2.transform(values, to_rgb)[:, 0]


def components_at(
    planes: tuple[Plane, ...], points: Points, to_chroma: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Components (n, 1, 3) at stored points (n, 2), as in `sample_planes`; 128 where there is no chroma."""
    luma, *chroma = planes
    values = np.empty((len(points), 1, 3), np.float32)
    values[:, 0, 0] = _bilinear(points, luma)[0]
    values[:, 0, 1:] = 128
    if chroma:
        values[:, 0, 1], values[:, 0, 2] = _bilinear((points - to_chroma[2:]) * to_chroma[:2], *chroma)
    return values


def _bilinear(points: Points, *planes: Plane) -> list[NDArray[np.float32]]:
    """Values (n,) or (n, c) of stored planes of one size at stored points (n, 2); the border is repeated."""
    limit = np.array(planes[0].shape[1::-1])
    first = np.minimum(np.maximum(np.floor(np.minimum.reduce(points)), 0), limit - 1)
    last = np.minimum(np.maximum(np.floor(np.maximum.reduce(points)) + 2, first + 1), limit)
    (left, top), (right, bottom) = first.astype(int), last.astype(int)
    inside = points - np.float32(first)
    return [remap_points(plane[top:bottom, left:right].astype(np.float32), inside) for plane in planes]
