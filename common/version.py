"""The version of Guise that is installed."""

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _installed


def version() -> str:
    """Such as '0.1.0'; '0' when Guise runs without being installed."""
    try:
        return _installed("guise-video")
    except PackageNotFoundError:
        return "0"
