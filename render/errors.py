"""The one error of this package that a user may see."""


class RendererError(ValueError):
    """What was expected, what was got and what to do, in one sentence."""
