"""Drawing the synthesised face: GL and CPU compositors that agree.

`make_compositor` gives an object that warps a texture on the reference grid by a triangle mesh and blends
it into the rectangle of the frame that holds the face. Two implementations follow one contract,
`Compositor`: `gl` draws in two shader passes through EGL, `cpu` is its twin in NumPy and OpenCV.

Images are (h, w, 3) uint8 in any 3-channel space; coordinates are pixels, x right, y down, pixel centres at
integers. The half-pixel shift to GL is in `guise.render.pixel_centres` and nowhere else.
"""

from guise.render.compositor import Compositor, make_compositor
from guise.render.context import GLInfo, GLMissing, create_context, probe_gl
from guise.render.errors import RendererError
from guise.render.feathering import feather

__all__ = [
    "Compositor",
    "GLInfo",
    "GLMissing",
    "RendererError",
    "create_context",
    "feather",
    "make_compositor",
    "probe_gl",
]
