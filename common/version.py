"""The version of Guise that is installed."""


def version() -> str:
    """Such as '0.1.0'; '0' when Guise runs without being installed."""
    from importlib.metadata import PackageNotFoundError, version  # of which few commands have need

    try:
        return version("guise-video")
    except PackageNotFoundError:
        return "0"
