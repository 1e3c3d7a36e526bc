"""Which output a name asks for, and whether it can be written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from guise.app.media.animation_writer import FORMS, LOSSLESS
from guise.app.media.encoder import EncodeOptions
from guise.app.media.errors import MediaError
from guise.app.media.file_kind import READ_ONLY_SUFFIXES, has_image_name
from guise.app.media.image_writing import PAGES, lossy_form
from guise.app.media.input import MediaInput
from guise.app.media.picture_inputs import AnimationInput, ImageInput
from guise.app.media.picture_sinks import AnimationSink, FolderSink, ImageSink, PagesSink
from guise.app.media.pipes import is_pipe
from guise.app.media.sink import Sink, VideoSink

_NO_TAGS: Mapping[str, str] = MappingProxyType({})
_DEFAULTS = EncodeOptions()


def open_sink(
    path: Path | str, media: MediaInput, options: EncodeOptions = _DEFAULTS, *, force: bool = False,
    tags: Mapping[str, str] = _NO_TAGS, size: tuple[int, int] | None = None, private: bool = False,
) -> Sink:  # fmt: skip
    """Open the output for an input; its suffix determines the kind.  Whatever can fail early fails here.

    force : replace an existing output.   tags : metadata to add.
    size : (width, height) of the frames if it differs from the input's; they are then taken as shown.
    private : keep only the audio of the input's other streams, without its names, and leave out all metadata,
        chapters and closed captions.
    Raises MediaError for a user's mistake, and then leaves nothing behind.
    """
    path = Path(path)
    if is_pipe(path):
        return VideoSink(path, media, options, force=force, tags=tags, size=size, private=private)
    check_free(path, media, force)
    if not path.is_dir() and is_animation(path, media):
        _check_animation(path, options)
        return AnimationSink(path, media, options, force=force, tags=tags, size=size)
    if path.suffix.lower() in PAGES and media.kind == "images" and not path.is_dir():
        return PagesSink(path, force=force, tags=tags)
    if has_image_name(path) and not path.is_dir():
        _check_image(path, media, options)
        return ImageSink(path, force=force, tags=tags, note=media.problems.note)
    if path.suffix.lower() in READ_ONLY_SUFFIXES:
        raise MediaError(
            f"{path.name} is a picture that Guise reads but does not write: use .png, .jpg or .webp."
        )
    if media.kind == "images" and (path.is_dir() or not path.suffix):
        _check_images(media, options)
        return FolderSink(path, force=force, tags=tags, note=media.problems.note)
    return VideoSink(path, media, options, force=force, tags=tags, size=size, private=private)


def check_free(path: Path, media: MediaInput, force: bool) -> None:
    """Raise MediaError when the output would replace something it must not."""
    if path.exists() and media.path.exists() and path.samefile(media.path):
        raise MediaError(f"{path} is the input itself: choose another name for the output.")
    if path.is_dir() and media.kind != "images":
        raise MediaError(f"{path} is a folder: give a file name such as {path / 'out.mp4'}.")
    if path.exists() and not force and not (path.is_dir() and not any(path.iterdir())):
        raise MediaError(f"{path} exists: use --force to replace it, or choose another name.")


def _check_image(path: Path, media: MediaInput, options: EncodeOptions) -> None:
    if media.kind != "image":
        raise MediaError(
            f"The output {path.name} is one image but {media.name} is not: write to out.webp, which moves, or "
            "to a video such as out.mp4."
        )
    if options.lossless and (form := lossy_form(path.suffix)):
        raise MediaError(f"{path.name} cannot be lossless, as {form} never is: write to .png.")


def is_animation(path: Path, media: MediaInput) -> bool:
    """Whether an output is an animated picture: its form moves, and so does the input, or it has no other form."""
    form = FORMS.get(path.suffix.lower())
    if form is None or (path.suffix.lower() == ".png" and not isinstance(media, AnimationInput)):
        return False
    return media.kind != "image" or not has_image_name(path)


def _check_animation(path: Path, options: EncodeOptions) -> None:
    form = FORMS[path.suffix.lower()]
    if options.lossless and form not in LOSSLESS:
        raise MediaError(
            f"{path.name} cannot be lossless, as {form.upper()} never is: write to .webp or .mkv."
        )


def _check_images(media: MediaInput, options: EncodeOptions) -> None:
    files = media.files if isinstance(media, ImageInput) else []
    lossy = next((file for file in files if lossy_form(file.suffix)), None)
    if options.lossless and lossy:
        raise MediaError(
            f"{lossy.name} cannot be written lossless, as {lossy_form(lossy.suffix)} never is: "
            "write to a video such as out.mkv."
        )
