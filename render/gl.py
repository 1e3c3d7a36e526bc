"""The compositor in two shader passes.

Pass 1 draws the mesh with the synthesised texture, pass 2 blends it into the frame's pixels. Both touch
only the mesh's bounding box within the rectangle: that is all that is sent and read back. Textures on the
GL side grow in steps of 64 pixels and are partly used, so that a moving face needs no allocation. Pixels
travel as RGBA, because three-channel transfers are converted pixel by pixel by the driver.
"""

import threading
from importlib.resources import files

import cv2
import moderngl
import numpy as np

from guise.common.arrays import F64, U8, Floating
from guise.common.closing import Closing
from guise.render.buffers import Alpha, Scratch, Texels, Texture, check_opacity, output_for
from guise.render.context import check, create_context, describe
from guise.render.errors import RendererError
from guise.render.mesh import SUBPIXELS, Box, TexturedMesh, back_first, bounding_box, outline_box, snap
from guise.render.pixel_centres import to_clip_space, to_texture_space

_TEXTURE_STEP_PIXELS = 64


class GLCompositor(Closing):
    """`guise.render.compositor.Compositor` in GL. Use it in the thread that made it."""

    name = "gl"

    def __init__(self, mesh: TexturedMesh, alpha: Alpha) -> None:
        self._mesh = mesh
        self._texels = Texels(mesh, alpha)
        self._pixels = Scratch(np.uint8)
        self._thread = threading.get_ident()
        self._closed = False
        self._context = create_context()
        try:
            with self._context:
                self._make_pipeline()
                self._targets = _Targets(self._context, 0, 0)
                check(self._context, "building the shaders")
                self.info = describe(self._context)
        except Exception:
            self._context.release()
            raise
        self.description = f"GL: {self.info.description}"

    @property
    def context(self) -> moderngl.Context:
        """The GL context, for checks."""
        return self._context

    def set_alpha(self, alpha: Alpha) -> None:
        """Take another (th, tw) alpha."""
        self._texels.set_alpha(alpha)

    def composite(
        self,
        roi: U8,
        texture: Texture,
        vertices: Floating,
        opacity: float = 1.0,
        out: U8 | None = None,
    ) -> U8:
        """See `guise.render.compositor.Compositor.composite`."""
        result = output_for(roi, out)
        snapped = snap(vertices, len(self._mesh.uv))
        box = bounding_box(snapped, roi.shape[1], roi.shape[0])
        rgba = self._texels.load(texture)
        if check_opacity(opacity) > 0 and not box.empty:
            self._enter_thread()
            with self._context:
                self._draw_warp(rgba, snapped, box)
                self._draw_blend(box.of(result), opacity)
                check(self._context, "compositing")
        return result

    def warp(
        self,
        shape: tuple[int, int],
        texture: Texture,
        vertices: Floating,
    ) -> U8:
        """See `guise.render.compositor.Compositor.warp`."""
        result = np.zeros((*shape, 4), np.uint8)
        snapped = snap(vertices, len(self._mesh.uv))
        box = bounding_box(snapped, shape[1], shape[0])
        rgba = self._texels.load(texture)
        if not box.empty:
            self._enter_thread()
            with self._context:
                self._draw_warp(rgba, snapped, box)
                box.of(result)[:] = self._read(self._targets.warped_buffer, box.width, box.height)
                check(self._context, "warping")
        return result

    def close(self) -> None:
        """Release the context with everything in it; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._context.release()

    def _make_pipeline(self) -> None:
        context, mesh = self._context, self._mesh
        context.enable_only(moderngl.NOTHING)
        self._face = context.texture((mesh.width, mesh.height), 4)
        self._face.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._face.repeat_x = self._face.repeat_y = False
        self._positions = context.buffer(reserve=mesh.uv.nbytes, dynamic=True)
        uv = context.buffer(to_texture_space(mesh.uv, mesh.width, mesh.height).tobytes())
        self._triangles = context.buffer(mesh.triangles.tobytes(), dynamic=True)
        warp, self._blend = program(context, "warp"), program(context, "blend")
        warp["face"] = 0
        self._blend["warped"], self._blend["frame"] = 0, 1
        inputs = [(self._positions, "2f", "position"), (uv, "2f", "uv")]
        self._mesh_array = context.vertex_array(warp, inputs, index_buffer=self._triangles)
        self._box_array = context.vertex_array(self._blend, [])

    def _draw_warp(self, rgba: U8, snapped: F64, box: Box) -> None:
        """Pass 1, into the corner of the warped target.

        The viewport is the whole mesh, of which the scissor keeps the box: clipping triangles at the edge of
        a smaller viewport would move their other edges a little.
        """
        self._targets, mesh = self._targets.holding(box.width, box.height), self._mesh
        whole = outline_box(snapped)
        pixels = snapped / SUBPIXELS - (whole.x0, whole.y0)
        self._triangles.write(mesh.triangles[back_first(snapped, mesh.triangles, mesh.grid)].tobytes())
        self._positions.write(to_clip_space(pixels, whole.width, whole.height).tobytes())
        self._face.write(rgba)
        self._face.use(0)
        target = self._targets.warped_buffer
        target.viewport = (whole.x0 - box.x0, whole.y0 - box.y0, whole.width, whole.height)
        target.scissor = (0, 0, box.width, box.height)
        target.use()
        target.clear(viewport=target.scissor)
        self._mesh_array.render(moderngl.TRIANGLES)

    def _draw_blend(self, view: U8, opacity: float) -> None:
        """Pass 2, over the frame's pixels in `view`."""
        height, width = view.shape[:2]
        targets = self._targets
        staged = self._pixels.view(height, width, 4)
        cv2.cvtColor(view, cv2.COLOR_RGB2RGBA, dst=staged)
        targets.frame.write(staged, viewport=(0, 0, width, height))
        targets.warped.use(0)
        targets.frame.use(1)
        self._blend["opacity"], self._blend["size"] = opacity, (width, height)
        targets.blended_buffer.viewport = (0, 0, width, height)
        targets.blended_buffer.use()
        self._box_array.render(moderngl.TRIANGLES, vertices=3)
        cv2.cvtColor(self._read(targets.blended_buffer, width, height), cv2.COLOR_RGBA2RGB, dst=view)

    def _read(self, buffer: moderngl.Framebuffer, width: int, height: int) -> U8:
        pixels: U8 = self._pixels.view(height, width, 4)
        buffer.read_into(pixels, viewport=(0, 0, width, height), components=4)
        return pixels

    def _enter_thread(self) -> None:
        if self._closed:
            raise RendererError("the compositor is closed: make another")
        if threading.get_ident() != self._thread:
            raise RendererError("a GL compositor must be used in the thread that made it")


class _Targets:
    """The frame's pixels, the warped face and the blend, each at least width x height."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self._context = context
        self._size = size = (_round_up(width), _round_up(height))
        self.frame = context.texture(size, 4)
        self.warped = context.texture(size, 4)
        self._blended = context.texture(size, 4)
        for texture in (self.frame, self.warped, self._blended):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.warped_buffer = context.framebuffer([self.warped])
        self.blended_buffer = context.framebuffer([self._blended])

    def holding(self, width: int, height: int) -> "_Targets":
        """Itself when large enough, else larger ones in its place."""
        if width <= self._size[0] and height <= self._size[1]:
            return self
        larger = _Targets(self._context, max(width, self._size[0]), max(height, self._size[1]))
        self._release()  # only now: making a framebuffer binds the one bound before again, which must exist
        return larger

    def _release(self) -> None:
        for part in (self.warped_buffer, self.blended_buffer, self.frame, self.warped, self._blended):
            part.release()


def _round_up(pixels: int) -> int:
    step = _TEXTURE_STEP_PIXELS
    return max(step, -(-pixels // step) * step)


def program(context: moderngl.Context, name: str) -> moderngl.Program:
    """The program of the two shaders of that name in render/shaders."""
    shaders = files("guise.render") / "shaders"
    return context.program(
        vertex_shader=(shaders / f"{name}.vert.glsl").read_text("utf-8"),
        fragment_shader=(shaders / f"{name}.frag.glsl").read_text("utf-8"),
    )
