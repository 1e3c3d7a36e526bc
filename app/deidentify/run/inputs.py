"""From the command's INPUT... to pairs of an input and its output.  Nothing is read or written here.

A folder stands for the videos and images in it; one with images alone is one clip, as everywhere in Guise.  Outputs go
beside the inputs or, with their part of the tree, into a folder, and always say ``_deidentified`` in the name unless
the user names the single output.
"""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from guise.app.deidentify.options import DeidentifyError
from guise.app.deidentify.run import remote
from guise.app.media.animation_writer import FORMS
from guise.app.media.file_kind import IMAGE_SUFFIXES, READ_ONLY_SUFFIXES, is_picture, kind_of
from guise.app.media.image_writing import PAGES, can_write
from guise.common.files import fitting_name, natural_key

OWN_SUFFIXES = (".report.json", ".report.html", ".tracks.json", ".tracks.jpg", ".part", ".work")
VIDEO_SUFFIXES = frozenset(
    {
        ".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".ts", ".mts", ".m2ts", ".3gp", ".3g2",
        ".m2t", ".mod", ".tod", ".qt", ".divx", ".ogm", ".rm", ".rmvb", ".h264", ".264", ".h265", ".265", ".hevc",
        ".ivf", ".obu", ".m1v", ".m2v", ".mjpeg", ".mjpg",
        ".flv", ".f4v", ".wmv", ".asf", ".ogv", ".nut", ".mxf", ".vob", ".dv", ".gif", ".apng", ".y4m",
    }
)  # fmt: skip
_PATTERN = frozenset("*?[")


@dataclass(frozen=True)
class Purpose:
    """What is done to the inputs: a verb for messages, the mark that is added to their names, and whether a run writes
    reports and can be resumed."""

    verb: str
    mark: str
    resumes: bool = False


DEIDENTIFY, SWAP = Purpose("de-identify", "_deidentified", resumes=True), Purpose("swap", "_swapped")


class InputError(DeidentifyError):
    """Inputs or outputs that can't be used as given; one sentence."""


@dataclass(frozen=True)
class FilePair:
    """An input and its output.

    Parameters
    ----------
    input, output : where they are on this machine, absolute.
    name : the input as the user knows it.
    fetch : URL from which the input is downloaded first, or "".
    put : URL to which the output is uploaded last, or "".
    """

    input: Path
    output: Path
    name: str
    fetch: str = ""
    put: str = ""

    @property
    def shown_output(self) -> str:
        """The output as the user knows it."""
        return self.put or short(self.output)


@dataclass
class BatchPlan:
    """What will be done, and sentences about what won't."""

    pairs: list[FilePair] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _FoundInput:
    """An input: a path or a URL; and the folder of it below the folder or pattern that was given."""

    place: Path | str
    below: PurePath = field(default_factory=PurePath)


@dataclass(frozen=True)
class _Search:
    """How inputs are found: see `make_plan`; and the notes about what is left out."""

    recursive: bool
    each: bool
    purpose: Purpose
    notes: list[str]

    def why_not(self, name: str, path: Path | None = None) -> str:
        """Why a file of a folder isn't an input; "" when it is.   path : where it is, if on this machine."""
        folder = path is not None and path.is_dir()
        if name.startswith("."):
            return "hidden"
        if name.endswith(OWN_SUFFIXES) or (name if folder else PurePath(name).stem).endswith(
            self.purpose.mark
        ):
            return "from an earlier run"
        known = (
            folder or PurePath(name).suffix.lower() in VIDEO_SUFFIXES | IMAGE_SUFFIXES | READ_ONLY_SUFFIXES
        )
        return "" if known or (path is not None and kind_of(path) != "video") else "not a video or image"


def make_plan(
    inputs: Sequence[str],
    output: str | None,
    work: Path,
    suffix_for: Callable[[Path], str],
    *,
    recursive: bool,
    each: bool = False,
    purpose: Purpose = DEIDENTIFY,
) -> BatchPlan:
    """What is read and written.

    Parameters
    ----------
    inputs : files, folders, patterns, URLs.
    output : the output of the one input, or a folder for all; beside the inputs when None.
    work : where copies of remote files lie.
    suffix_for : the suffix of the container for a video's result.
    recursive : include the subfolders of folders.
    each : every image of a folder is an input of its own, even if there is nothing else in it.
    purpose : what for.

    Raises
    ------
    InputError, RemoteError
        Nothing to do, something that does not exist, or two inputs with one output.
    """
    plan = BatchPlan()
    search = _Search(recursive, each, purpose, plan.notes)
    found = [one for text in inputs for one in _find(text, search)]
    found = list({_identity(one.place): one for one in reversed(found)}.values())[::-1]
    target = _OutputTarget(output, single=len(found) == 1 and _is_file(inputs, found[0]))
    plan.pairs += _apart([_OutputNamer(one, target, work, suffix_for, purpose.mark) for one in found])
    plan.notes += [note for pair in plan.pairs for note in _renamed(pair, chosen=bool(target.file))]
    _require_apart(plan.pairs)
    return plan


def require_possible(
    pairs: Sequence[FilePair], *, force: bool, resume: bool = False, purpose: Purpose = DEIDENTIFY
) -> None:
    """Raise InputError when an output could not be written, or would replace something."""
    there = [pair for pair in pairs if is_there(pair)]
    if there and not (force or resume):
        more = f" (and {len(there) - 1} more)" if len(there) > 1 else ""
        rest = " --resume to do only the rest," if purpose.resumes else ""
        raise InputError(
            f"{there[0].shown_output} exists{more}: use --force to replace it,{rest} or -o to write elsewhere"
        )
    reports = [pair.output.with_name(fitting_name(pair.output.stem, ".report.json")) for pair in pairs]
    if purpose.resumes and not (force or resume) and (report := next(filter(Path.exists, reports), None)):
        raise InputError(
            f"{short(report)} exists without its output: use --force to replace it, or -o to write elsewhere"
        )
    for folder in dict.fromkeys(_nearest_folder(pair.output) for pair in pairs):
        if not os.access(folder, os.W_OK):
            raise InputError(f"the folder {short(folder)} can't be written to: choose another with -o")
    _require_no_input_replaced(pairs)


def is_there(pair: FilePair) -> bool:
    """Whether the output exists."""
    return remote.exists(pair.put) if pair.put else os.path.lexists(pair.output)


def short(path: Path) -> str:
    """A path as seen from here when it is below."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) and path != here else path)


# -- finding inputs ---------------------------------------------------------------------------------------------


def _find(text: str, search: _Search) -> list[_FoundInput]:
    if remote.is_url(text):
        return _find_remote(text, search)
    path = Path(text)
    if path.is_dir():
        return _find_in(path, search)
    if os.path.lexists(path):
        return [_FoundInput(path.absolute())]
    if _PATTERN & set(text):
        return _find_matches(text, search)
    raise InputError(f"{text} does not exist: give a video, an image, a folder, a pattern in quotes or a URL")


def _find_in(folder: Path, search: _Search) -> list[_FoundInput]:
    """The inputs in a folder, which may be one itself."""
    skipped: Counter[str] = Counter()
    found = [
        _FoundInput(path.absolute(), below) for path, below in _walk(folder, PurePath(), search, skipped)
    ]
    search.notes.extend(_skipped(str(folder), skipped))
    if not found:
        hint = "" if search.recursive or not skipped["subfolders"] else "; use --recursive for its subfolders"
        raise InputError(f"the folder {folder} holds no video or image to {search.purpose.verb}{hint}")
    return found


def _walk(
    folder: Path, below: PurePath, search: _Search, skipped: Counter[str]
) -> Iterator[tuple[Path, PurePath]]:
    files, folders = _content(folder, search, skipped)
    images = [file for file in files if is_picture(file)]
    if len(images) == len(files) > 1 and not search.each:
        yield folder, below.parent
    else:
        yield from ((file, below) for file in files)
    for one in folders:
        if not search.recursive:
            skipped["subfolders"] += 1
        elif one.is_symlink():
            skipped["links to folders"] += 1
        else:
            yield from _walk(one, below / one.name, search, skipped)


def _content(folder: Path, search: _Search, skipped: Counter[str]) -> tuple[list[Path], list[Path]]:
    """Videos and images, and folders; other, hidden and earlier output files are counted."""
    try:
        entries = sorted(folder.iterdir(), key=lambda path: natural_key(path.name))
    except OSError as error:
        raise InputError(
            f"the folder {folder} can't be read ({error.strerror}): check its permissions, or leave it out"
        ) from error
    reasons = {path: search.why_not(path.name, path) for path in entries}
    skipped.update(reason for reason in reasons.values() if reason)
    wanted = [path for path, reason in reasons.items() if not reason]
    return [p for p in wanted if not p.is_dir()], [p for p in wanted if p.is_dir()]


def _skipped(where: str, counts: Counter[str]) -> list[str]:
    """The sentence about what was left out."""
    if not counts:
        return []
    return [f"{where}: skipped {', '.join(f'{count} {reason}' for reason, count in counts.items())}"]


def _find_matches(text: str, search: _Search) -> list[_FoundInput]:
    """The files that a pattern stands for."""
    parts = Path(text).parts
    first = next(i for i, part in enumerate(parts) if _PATTERN & set(part))
    root = Path(*parts[:first])
    try:
        matches = sorted(root.glob(str(Path(*parts[first:]))), key=lambda path: natural_key(str(path)))
    except ValueError as error:
        raise InputError(
            f"{text} isn't a valid pattern: ** must stand alone between slashes, as in 'films/**/*.mp4'"
        ) from error
    files = [path for path in matches if not path.is_dir()]
    hidden = [any(part.startswith(".") for part in path.relative_to(root).parts) for path in files]
    reasons = [
        "hidden" if h else search.why_not(path.name, path) for path, h in zip(files, hidden, strict=True)
    ]
    search.notes.extend(_skipped(text, Counter(reason for reason in reasons if reason)))
    found = [path for path, reason in zip(files, reasons, strict=True) if not reason]
    if not found:
        raise InputError(f"no video or image matches {text}")
    return [_FoundInput(path.absolute(), path.relative_to(root).parent) for path in found]


def _find_remote(url: str, search: _Search) -> list[_FoundInput]:
    """The files that a URL stands for."""
    files = dict(remote.files_at(url, recursive=search.recursive))
    if list(files) == [url]:
        return [_FoundInput(url)]
    reasons = {one: search.why_not(remote.name_of(one)) for one in files}
    search.notes.extend(_skipped(url, Counter(reason for reason in reasons.values() if reason)))
    found = sorted((one for one, reason in reasons.items() if not reason), key=natural_key)
    if not found:
        raise InputError(f"{url} holds no video or image to {search.purpose.verb}")
    return [_FoundInput(one, PurePath(files[one]).parent) for one in found]


def _identity(place: Path | str) -> str:
    return place if isinstance(place, str) else os.path.normpath(place)


# -- naming outputs ---------------------------------------------------------------------------------------------


class _OutputTarget:
    """What -o says: `file`, the one output, `folder` for all, or neither; each a path or a URL."""

    def __init__(self, output: str | None, *, single: bool) -> None:
        self.file = self.folder = ""
        if output is None:
            return
        names_file = bool(PurePath(output).suffix) and not output.endswith(("/", os.sep))
        if Path(output).is_dir() or not names_file:
            self.folder = output
        elif single:
            self.file = output
        else:
            raise InputError(
                f"-o {output} names one file, but the inputs are more than one file: give a folder, such as "
                f"{output}{os.sep}"
            )


def _is_file(inputs: Sequence[str], one: _FoundInput) -> bool:
    """Whether the only input was named itself, or is a clip of images, so that its output can be named, too."""
    return len(inputs) == 1 and (
        isinstance(one.place, str) or not Path(inputs[0]).is_dir() or one.place.is_dir()
    )


class _OutputNamer:
    """Names the output of an input."""

    def __init__(
        self,
        one: _FoundInput,
        target: _OutputTarget,
        work: Path,
        suffix_for: Callable[[Path], str],
        mark: str,
    ) -> None:
        self._mark = mark
        self._url = one.place if isinstance(one.place, str) else ""
        self._input = _copy_of(self._url, work) if self._url else Path(one.place)
        self._below, self._target, self._work = one.below, target, work
        self._suffix = _picture_suffix(self._input) or suffix_for(self._input)

    def pair(self, *, whole: bool = False) -> FilePair:
        """Input and output; the output with the `whole` name of the input in its own, or without its suffix."""
        output = self._target.file or self._output(whole or self._suffix != self._input.suffix)
        name = remote.shown(self._url) or short(self._input)
        if not remote.is_url(output):
            return FilePair(self._input, Path(os.path.abspath(output)), name, self._url)
        if not remote.is_writable(output):
            raise InputError(
                f"{output} can't be written to: give a local folder, or one at s3:// or gs://, with -o"
            )
        if self._input.is_dir():
            raise InputError(
                f"{name} is a folder of images, which can't be written to a URL: give a local folder with -o"
            )
        return FilePair(self._input, _copy_of(output, self._work), name, self._url, output)

    def _output(self, whole: bool) -> str:
        folder = self._input.is_dir()
        stem = self._input.name if whole or folder else self._input.stem
        name = fitting_name(stem, self._mark + ("" if folder else self._suffix))
        if self._target.folder:
            return remote.join(self._target.folder, str(self._below / name))
        return (
            remote.join(remote.folder_of(self._url), name) if self._url else str(self._input.with_name(name))
        )


def _picture_suffix(path: Path) -> str:
    """The suffix of the output for a picture or several: the input's own where that can be written; "" for a video."""
    kind, suffix = "image" if path.is_dir() else kind_of(path), path.suffix.lower()
    if kind == "video":
        return ""
    written = {
        "image": can_write(suffix) or suffix == ".gif",
        "animation": suffix in FORMS,
        "pages": suffix in PAGES,
    }
    others = {"image": ".png", "animation": ".webp", "pages": ".tif"}
    return path.suffix if path.is_dir() or written[kind] else others[kind]


def _apart(namers: Sequence[_OutputNamer]) -> list[FilePair]:
    """The pairs; outputs that differ in their suffix alone get the whole names of their inputs, as do their reports."""
    pairs = [namer.pair() for namer in namers]
    names = Counter(_report_name(pair) for pair in {pair.shown_output: pair for pair in pairs}.values())
    return [
        n.pair(whole=True) if names[_report_name(p)] > 1 else p for n, p in zip(namers, pairs, strict=True)
    ]


def _report_name(pair: FilePair) -> str:
    return str(PurePath(pair.put or pair.output).with_suffix(".report.json"))


def _copy_of(url: str, work: Path) -> Path:
    """Where the local copy of a remote file lies; a later run finds it again."""
    return (
        work.absolute()
        / hashlib.sha256(url.encode(errors="surrogateescape")).hexdigest()[:16]
        / remote.name_of(url)
    )


def _renamed(pair: FilePair, *, chosen: bool) -> list[str]:
    """A note when an output has another format than its input, and the user did not choose it."""
    old, new = pair.input.suffix.lower(), pair.output.suffix.lower()
    if pair.input.is_dir() or old == new or chosen:
        return []
    return [
        f"{pair.name}: written as {new}" + ("" if old == "" else f", because {old} can't hold the result")
    ]


def _require_apart(pairs: Sequence[FilePair]) -> None:
    """Raise InputError when two inputs have one output, or an output is an input."""
    taken: dict[str, FilePair] = {}
    for pair in pairs:
        output = os.path.normcase(pair.put or pair.output)
        if output in taken:
            raise InputError(
                f"{taken[output].name} and {pair.name} would both be written to {pair.shown_output}: rename one, or "
                "process them separately with different -o"
            )
        taken[output] = pair
    for pair in pairs:
        clash = taken.get(os.path.normcase(pair.fetch or pair.input))
        if clash is not None:
            raise _replaces_input(clash)


def _require_no_input_replaced(pairs: Sequence[FilePair]) -> None:
    """Raise InputError when an output is an input under another name (a link)."""
    inputs = {(facts.st_dev, facts.st_ino) for pair in pairs if (facts := _stat(pair.input))}
    for pair in pairs:
        facts = _stat(pair.output)
        if facts and (facts.st_dev, facts.st_ino) in inputs:
            raise _replaces_input(pair)


def _replaces_input(pair: FilePair) -> InputError:
    return InputError(
        f"{pair.shown_output}, the output for {pair.name}, is itself an input: choose another with -o"
    )


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None


def _nearest_folder(path: Path) -> Path:
    """The folder that exists in which a file, or the folders above it, will be made."""
    return next(folder for folder in path.parents if folder.is_dir())
