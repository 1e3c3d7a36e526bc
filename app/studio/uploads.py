"""Uploads of videos, pictures and meshes, checked before they are kept."""

from __future__ import annotations

import tempfile
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nicegui import events, run, ui

from guise.app.media import open_input
from guise.app.media.animation_writer import FORMS
from guise.app.media.file_kind import kind_of
from guise.app.media.images import IMAGE_SUFFIXES, read_deep
from guise.app.media.pictures import save_picture, shrunk
from guise.app.studio import store
from guise.app.studio.pictures import SHOWN_SUFFIXES
from guise.app.studio.request_guard import too_large
from guise.app.studio.site import Studio, show_error
from guise.app.studio.store import StudioError, Upload, preview_of
from guise.common.errors import GuiseError
from guise.common.failures import explain

PREVIEW_HEIGHT_PIXELS = 320
MESH_PREVIEW_YAW_DEGREES = -25.0


@dataclass(frozen=True)
class UploadKind:
    """A kind of file that can be uploaded.

    Parameters
    ----------
    name : in the store.   noun : for the user, with an article.   media : media type for the browser's file dialog.
    advice : which files can be read.
    check : check(path, preview) raises GuiseError for a file that cannot be read, and draws its preview.
    moves : whether it is of several pictures.
    """

    name: str
    noun: str
    media: str
    suffixes: frozenset[str]
    advice: str
    check: Callable[[Path, Path], None]
    moves: bool = False


def _check_video(path: Path, preview: Path) -> None:
    with open_input(path) as media:
        if media.kind == "image":
            raise StudioError("it is a single picture")


def _check_picture(path: Path, preview: Path) -> None:
    rgb = read_deep(path).rgb8()
    save_picture(preview, shrunk(rgb, PREVIEW_HEIGHT_PIXELS / rgb.shape[0]))


def _check_mesh(path: Path, preview: Path) -> None:
    from guise.aam.similarity import Failed
    from guise.analogy.feature_points import find_feature_points
    from guise.analogy.formats.files import read_mesh
    from guise.app.meshes.pictures import DrawnHead, HeadView

    mesh = read_mesh(path).mesh
    points = find_feature_points(mesh)
    view = HeadView.of(mesh.vertices, None if isinstance(points, Failed) else points.positions)
    save_picture(preview, view.draw(DrawnHead(mesh.vertices, mesh.faces, "", view), MESH_PREVIEW_YAW_DEGREES))


CLIP = UploadKind(
    store.CLIP,
    "a video",
    "video/*",
    store.CLIP_SUFFIXES,
    "use an .mp4, .webm, .mov or .mkv.",
    _check_video,
    moves=True,
)
CONFIDENTIAL = replace(CLIP, name=store.CONFIDENTIAL)
PICTURE = UploadKind(
    "picture",
    "a picture",
    "image/*",
    IMAGE_SUFFIXES,
    "use a .jpg, .png, .heic, .avif or .webp.",
    _check_picture,
)
PHOTO = replace(PICTURE, name="photo", noun="a photo")  # of a person to be learned
FACE_PHOTO = replace(PHOTO, name="face-photo")  # of a person whose face is shown in one video
SWAP_PHOTO = replace(PHOTO, name="swap-photo")  # in which faces are swapped
CONFIDENTIAL_PHOTO = replace(PHOTO, name="confidential-photo")
MESH = UploadKind(
    "mesh",
    "a mesh",
    "",
    frozenset({".obj", ".ply", ".glb", ".vrm"}),
    "use an .obj, .ply, .glb or .vrm.",
    _check_mesh,
)


async def read_upload(
    studio: Studio, event: events.UploadEventArguments, kinds: Sequence[UploadKind]
) -> Upload:
    """Store an uploaded file.

    Raises StudioError when it is of none of the kinds or cannot be read; nothing is kept then.
    """
    file = Path(event.file.name)
    fitting = [kind for kind in kinds if file.suffix.lower() in kind.suffixes]
    if not fitting:
        raise StudioError(f"{file.name} {_none_of(kinds)}")
    with tempfile.TemporaryDirectory(dir=studio.store.incoming) as folder:
        part = Path(folder, f"part{file.suffix.lower()}")
        await event.file.save(part)
        moves = len(fitting) > 1 and await run.io_bound(kind_of, part) != "image"
        kind = next((kind for kind in fitting if kind.moves == moves), fitting[0])
        row = studio.store.add_upload(kind.name, file.stem, file.suffix)
        try:
            await run.io_bound(_require, kind, part, row)
            part.replace(row.path)
        except BaseException:
            studio.store.remove_upload(row.id)
            raise
    return row


def shown(studio: Studio, path: Path, label: str) -> ui.element:
    """A video or a picture, which may move, with a label for screen readers."""
    if path.suffix.lower() not in IMAGE_SUFFIXES | FORMS.keys():
        video = ui.video(studio.url(path))
        video.props["aria-label"] = label
        return video
    if path.suffix.lower() not in SHOWN_SUFFIXES | FORMS.keys():
        path = preview_of(path)
    picture = ui.element("img")
    picture.props["src"], picture.props["alt"] = studio.url(path), label
    return picture


def uploader(
    studio: Studio, label: str, done: Callable[[Any], Awaitable[None] | None], kinds: Sequence[UploadKind] = (CLIP,),
    *, several: bool = False, hint: str = "",
) -> ui.upload:  # fmt: skip
    """A place for files, which are dropped on it, pasted, or chosen with its button, and uploaded at once.

    done : called with each upload; why a file is refused is said.   several : more than one file can be given at once.
    hint : makes it a large place, with these words.
    """

    async def uploaded(event: events.UploadEventArguments) -> None:
        try:
            then = done(await read_upload(studio, event, kinds))
            if then is not None:
                await then
        finally:
            button.props(remove="loading")

    def refuse(reason: str) -> None:
        large = reason == "max-file-size"
        show_error(StudioError(too_large(studio.limit) if large else f"This {_none_of(kinds)}"))

    def failed() -> None:
        button.props(remove="loading")
        show_error(StudioError("The upload was interrupted: try again."))

    with ui.element("div").classes("drop w-full drop-large" if hint else "drop drop-small") as place:
        field = ui.upload(
            auto_upload=True, multiple=several, max_file_size=studio.limit, on_upload=uploaded
        ).classes("hidden")
        if hint:
            ui.icon("upload_file", size="3rem").props('aria-hidden="true"').classes("opacity-70 invitation")
            ui.label(hint).classes("invitation")
        button = ui.button(label, icon="upload")
    place.props["data-drop"] = str(field.id)
    field.props["accept"] = ",".join(
        filter(None, [part for kind in kinds for part in (kind.media, *sorted(kind.suffixes))])
    )
    button.on("click", js_handler=f"() => getElement({field.id}).$refs.qRef.pickFiles()")
    field.on("uploading", lambda: button.props("loading"))
    field.on("finish", field.reset, args=[])  # not earlier: it would interrupt the others
    field.on("failed", failed, args=[])
    why = "(entries) => emit(entries[0].failedPropValidation)"
    field.on("rejected", lambda event: refuse(event.args), js_handler=why)
    return field


def _require(kind: UploadKind, part: Path, row: Upload) -> None:
    try:
        kind.check(part, row.preview)
    except GuiseError as error:
        why = f"{row.name} isn't {kind.noun} that Guise reads: {kind.advice}"
        raise StudioError(
            why if kind.check is _check_video else explain(error)[0].replace(str(part), row.name)
        ) from error


def _none_of(kinds: Sequence[UploadKind]) -> str:
    return f"isn't {' or '.join(kind.noun for kind in kinds)}: {' Or '.join(kind.advice for kind in kinds)}"
