"""The contract of a compositor, and the choice between the two."""

from types import TracebackType
from typing import Literal, Protocol, Self, get_args

from guise.common.arrays import F32, I32, U8, Floating
from guise.render.buffers import Alpha, Texture, check_alpha
from guise.render.context import GLMissing, may_have_hardware, probe_gl
from guise.render.cpu import CpuCompositor
from guise.render.errors import RendererError
from guise.render.mesh import TexturedMesh

Renderer = Literal["auto", "gl", "cpu"]


class Compositor(Protocol):
    """Warps a texture by a mesh and blends it into the frame's rectangle.

    The mesh, its place on the reference grid and the texture's size are fixed; alpha may be changed. Triangles that are
    turned over lie behind the others. The two compositors differ by at most 4/255 in a pixel and 1/255 on average.

    name : 'gl' or 'cpu'.
    description : one line for the user: what draws and why.
    """

    @property
    def name(self) -> str: ...

    description: str

    def set_alpha(self, alpha: Alpha) -> None:
        """Use another (th, tw) alpha, float in [0, 1] or uint8."""

    def composite(
        self,
        roi: U8,
        texture: Texture,
        vertices: Floating,
        opacity: float = 1.0,
        out: U8 | None = None,
    ) -> U8:
        """alpha * warped texture + (1 - alpha) * roi.

        Parameters
        ----------
        roi : (h, w, 3) uint8, the frame's rectangle in any 3-channel space. It may be a slice of a frame:
            only the pixels of a row must lie side by side.
        texture : (th, tw, 3) uint8 or float32 in 0..255, the face on the reference grid in the same space;
            float32 is rounded to nearest.
        vertices : (v, 2) float, pixels of roi; they may lie outside it.
        opacity : in [0, 1], multiplies alpha.
        out : None, or (h, w, 3) uint8 for the result. `out=roi` composites in place, which copies nothing.

        Returns
        -------
        (h, w, 3) uint8
            `out`, or a new array that the caller owns. Bit-identical to roi where alpha is 0, hence
            wherever the mesh does not reach.

        Raises
        ------
        RendererError
            When an array has the wrong shape, type or values, or GL reports an error.
        """

    def warp(
        self,
        shape: tuple[int, int],
        texture: Texture,
        vertices: Floating,
    ) -> U8:
        """The warped texture alone, for tests and previews.

        Returns
        -------
        (h, w, 4) uint8, h, w = shape
            Colour and alpha (255 is 1); all zero where the mesh does not reach. A new array.
        """

    def close(self) -> None:
        """Release what the compositor holds. It also works as a context manager."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def make_compositor(
    renderer: str,
    triangles: I32,
    uv: F32,
    alpha: Alpha,
) -> Compositor:
    """The compositor that `renderer` names.

    `auto` is GL where GL is hardware, and the CPU where GL is software or missing: software GL works on the
    same cores about as fast, but needs a context and a driver. `benchmarks/` measures both on the computer
    at hand. The result's `description` says what was chosen and why.

    Parameters
    ----------
    renderer : 'auto', 'gl' or 'cpu'.
    triangles : (t, 3) int, vertex indices; later triangles are drawn over earlier ones.
    uv : (v, 2) float32, texture pixels of the vertices.
    alpha : (th, tw) float32 in [0, 1] or uint8, already feathered and 0 at the mesh's rim (see `feather`).

    Raises
    ------
    RendererError
        When an argument is wrong, or 'gl' is requested and missing.
    """
    if renderer not in get_args(Renderer):
        raise RendererError(f"renderer must be one of {', '.join(get_args(Renderer))}, got {renderer!r}")
    check_alpha(alpha)
    mesh = TexturedMesh(triangles, uv, *alpha.shape)
    if renderer == "gl":
        from guise.render.gl import GLCompositor

        return GLCompositor(mesh, alpha)
    if renderer == "cpu":
        return CpuCompositor(mesh, alpha)
    return _choose(mesh, alpha)


def _choose(mesh: TexturedMesh, alpha: Alpha) -> Compositor:
    found = probe_gl() if may_have_hardware() else GLMissing("no graphics device")
    if not isinstance(found, GLMissing) and not found.software:
        from guise.render.gl import GLCompositor

        chosen = GLCompositor(mesh, alpha)
        chosen.description += " (auto: GL is hardware)"
        return chosen
    why = found.reason if isinstance(found, GLMissing) else f"GL is software, {found.description}"
    fallback = CpuCompositor(mesh, alpha)
    fallback.description += f" (auto: {why})"
    return fallback
