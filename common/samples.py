"""Where the sample clips are that come with Guise."""

from __future__ import annotations

from pathlib import Path


def samples_folder() -> Path:
    """In the package, where it is installed from a wheel; in a checkout beside `common`."""
    home = Path(__file__).resolve().parents[1]
    return home / "samples" if (home / "samples").is_dir() else home / "sample_videos"
