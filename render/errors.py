"""The error of this package that a user may see."""

from guise.common.errors import GuiseError


class RendererError(GuiseError):
    """A wrong argument or a missing renderer: what was expected, what was found and what to do."""
