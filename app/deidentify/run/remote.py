"""Files behind URLs (s3://, gs://, https://, ..): listed, downloaded, and uploaded when the work is done."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from guise.app.deidentify.options import DeidentifyError
from guise.common.files import write_whole
from guise.common.text import first_line

_URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*://")
_PATTERN = re.compile(r"[*?\[]")
_WEB = ("http://", "https://")


class RemoteError(DeidentifyError):
    """A URL that can't be read or written; one sentence."""


def is_url(text: str) -> bool:
    """Whether a text is a URL rather than a path.

    >>> is_url("s3://films/a.mp4"), is_url("films/a.mp4"), is_url("C:/a.mp4")
    (True, False, False)
    """
    return _URL.match(text) is not None


def is_writable(url: str) -> bool:
    """Whether files can be uploaded there; web servers are read only."""
    return not url.startswith(_WEB)


def is_pattern(text: str) -> bool:
    """Whether a URL is a pattern; in a web address a question mark begins the query."""
    return not text.startswith(_WEB) and _PATTERN.search(text) is not None


def name_of(url: str) -> str:
    """The file's name.

    >>> name_of("https://films.org/a%20b.mp4?key=1"), name_of("s3://films/2026/a?.mp4")
    ('a b.mp4', 'a?.mp4')
    """
    path = unquote(urlsplit(url).path) if url.startswith(_WEB) else url
    return path.rstrip("/").rsplit("/", 1)[-1]


def shown(url: str) -> str:
    """The URL for messages and reports, without the query, which may hold a key.

    >>> shown("https://films.org/a.mp4?signature=secret")
    'https://films.org/a.mp4'
    """
    return url.split("?")[0] if url.startswith(_WEB) else url


def join(folder: str, name: str) -> str:
    """The URL of a file in a folder."""
    return f"{folder.rstrip('/')}/{name}"


def folder_of(url: str) -> str:
    """The URL of the folder that a file is in."""
    return url.rstrip("/").rsplit("/", 1)[0]


def common_folder(urls: Sequence[str]) -> str:
    """The URL of the folder that all files are in or below; that of the first when there is none.

    >>> common_folder(["s3://films/out/x/a.mp4", "s3://films/out/b.mp4"])
    's3://films/out'
    """
    folder = first = folder_of(urls[0])
    while not all(url.startswith(folder + "/") for url in urls):
        folder = folder_of(folder)
    return folder if is_url(folder) else first


def files_at(url: str, *, recursive: bool) -> list[tuple[str, str]]:
    """The files that a URL stands for: itself, a pattern's, or the content of a folder.

    Returns the URL of each, with its path below the folder or the fixed part of the pattern.
    """
    files, path = _open(url)
    with _explained(url):
        if is_pattern(url):
            found = [p for p, facts in files.glob(path, detail=True).items() if facts["type"] == "file"]
            root = path[: path.rindex("/", 0, _PATTERN.search(path).start()) + 1]  # type: ignore[union-attr]
        elif url.startswith(_WEB) or files.isfile(path):
            return [(url, name_of(url))]
        else:
            found, root = files.find(path, maxdepth=None if recursive else 1), path.rstrip("/") + "/"
        return [(str(files.unstrip_protocol(p)), p.removeprefix(root)) for p in found]


def exists(url: str) -> bool:
    """Whether there is a file."""
    files, path = _open(url)
    with _explained(url):
        return bool(files.exists(path))


def read(url: str) -> bytes:
    """The content of a small file."""
    files, path = _open(url)
    with _explained(url):
        return bytes(files.cat_file(path))


def fetch(url: str, path: Path) -> None:
    """Download a file."""
    files, place = _open(url)
    with _explained(url):
        write_whole(path, lambda part: files.get_file(place, str(part)))


def put(path: Path, url: str) -> None:
    """Upload a file; object storage shows it when it is complete."""
    files, place = _open(url)
    with _explained(url):
        files.makedirs(folder_of(place), exist_ok=True)
        files.put_file(str(path), place)


def _open(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    try:
        import fsspec
    except ImportError as error:
        raise RemoteError(f'{shown(url)} needs more packages: pip install "guise-video[cluster]"') from error
    try:
        return fsspec.core.url_to_fs(url)  # type: ignore[no-any-return]
    except ImportError as error:
        hint = re.search(r"nstall (\S+)", str(error))
        package = hint[1] if hint else "its package of fsspec"
        raise RemoteError(f"{shown(url)} needs one more package: pip install {package}") from error
    except Exception as error:
        raise RemoteError(
            f"{shown(url)} can't be opened ({first_line(error)}): give a path, s3://, gs:// or https://"
        ) from error


@contextmanager
def _explained(address: str) -> Iterator[None]:
    """Turn the errors of a file system in the block into one sentence."""
    url = shown(address)
    try:
        yield
    except FileNotFoundError as error:
        raise RemoteError(f"{url} does not exist: give a file, a folder or a pattern that does") from error
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None and not is_url(str(error.filename)):
            raise  # a full disk here
        reason = first_line(error).replace(address, url)
        raise RemoteError(
            f"{url} can't be read or written ({reason}): check the address and your credentials"
        ) from error
