"""The one error of this package that a user may see."""

from guise.common.errors import GuiseError


class RendererError(GuiseError):
    """What was expected, what was got and what to do, in one sentence."""
