"""Files that a visitor uploads: videos, pictures and meshes, looked at before they are kept."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from nicegui import events, run, ui

from guise.app.deidentify.run.inputs import VIDEO_SUFFIXES
from guise.app.media import open_source
from guise.app.media.images import IMAGE_SUFFIXES, read_deep
from guise.app.media.pictures import save_picture
from guise.app.studio.guard import too_large
from guise.app.studio.site import Studio, tell
from guise.app.studio.store import Clip, StudioError, Upload
from guise.common.errors import GuiseError
from guise.common.failures import explain

PREVIEW = 320  # pixels, height of a picture's preview
SIDE = -25.0  # degrees, from which a mesh is seen in its preview


@dataclass(frozen=True)
class Kind:
    """What may be uploaded.

    Parameters
    ----------
    name : in the store.   noun : for the user.   media : for the browser's choice of files.
    advice : which files can be read.   look : raises a user's mistake for one that cannot, and draws the preview.
    """

    name: str
    noun: str
    media: str
    suffixes: frozenset[str]
    advice: str
    look: Callable[[Path, Path], None]


def _look_at_video(path: Path, preview: Path) -> None:
    open_source(path).close()


def _look_at_picture(path: Path, preview: Path) -> None:
    rgb = read_deep(path).rgb8()
    width = max(1, round(rgb.shape[1] * PREVIEW / rgb.shape[0]))
    small = cv2.resize(rgb, (width, PREVIEW), interpolation=cv2.INTER_AREA)
    save_picture(preview, np.asarray(small, np.uint8))


def _look_at_mesh(path: Path, preview: Path) -> None:
    from guise.aam.similarity import Failed
    from guise.analogy.feature_points import find
    from guise.analogy.formats.files import read_mesh
    from guise.app.meshes.pictures import Head, Stand

    mesh = read_mesh(path).mesh
    points = find(mesh)
    stand = Stand.of(mesh.vertices, None if isinstance(points, Failed) else points.positions)
    save_picture(preview, stand.draw(Head(mesh.vertices, mesh.faces, "", stand), SIDE))


CLIP = Kind("clip", "video", "video/*", VIDEO_SUFFIXES, "use an .mp4, .webm, .mov or .mkv.", _look_at_video)
PICTURE = Kind(
    "picture", "picture", "image/*", IMAGE_SUFFIXES, "use a .png, .jpg, .tif or .webp.", _look_at_picture
)
MESH = Kind(
    "mesh", "mesh", "", frozenset({".obj", ".ply", ".glb"}), "use an .obj, .ply or .glb.", _look_at_mesh
)


async def read_upload(
    studio: Studio, event: events.UploadEventArguments, kinds: Sequence[Kind]
) -> Clip | Upload:
    """What was uploaded, which is on the disk by now.

    Raises StudioError when it is none of the kinds; nothing of it is kept then.
    """
    file = Path(event.file.name)
    kind = next((kind for kind in kinds if file.suffix.lower() in kind.suffixes), None)
    if kind is None:
        raise StudioError(f"{file.name} is {_none_of(kinds)}")
    row = _place(studio, kind, file)
    part = row.path.with_name(f"{row.path.stem}.part{row.path.suffix}")
    try:
        await event.file.save(part)
        await run.io_bound(_require, kind, part, row)
        part.replace(row.path)
    except BaseException:
        part.unlink(missing_ok=True)
        forget(studio, row)
        raise
    return row


def forget(studio: Studio, row: Clip | Upload) -> None:
    """Delete what was uploaded."""
    (studio.store.remove_clip if isinstance(row, Clip) else studio.store.remove_upload)(row.id)


def uploader(
    studio: Studio, label: str, done: Callable[[Any], Awaitable[None] | None], kinds: Sequence[Kind] = (CLIP,),
    *, several: bool = False,
) -> ui.upload:  # fmt: skip
    """A button that uploads a file as soon as it is chosen, and says why when it cannot be taken.

    done : called with the clip or the upload.   several : files may be chosen at once.
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
        tell(StudioError(too_large(studio.options.limit) if large else f"This is {_none_of(kinds)}"))

    def failed() -> None:
        button.props(remove="loading")
        tell(StudioError("The upload was broken off: try again."))

    field = ui.upload(
        auto_upload=True, multiple=several, max_file_size=studio.options.limit, on_upload=uploaded
    ).classes("hidden")
    field.props["accept"] = ",".join(
        filter(None, [part for kind in kinds for part in (kind.media, *sorted(kind.suffixes))])
    )
    button = ui.button(label, icon="upload")
    button.on("click", js_handler=f"() => getElement({field.id}).$refs.qRef.pickFiles()")
    field.on("uploading", lambda: button.props("loading"))
    field.on("finish", field.reset, args=[])  # not before: it would break off the others
    field.on("failed", failed, args=[])
    why = "(entries) => emit(entries[0].failedPropValidation)"
    field.on("rejected", lambda event: refuse(event.args), js_handler=why)
    return field


def _place(studio: Studio, kind: Kind, file: Path) -> Clip | Upload:
    if kind is CLIP:
        return studio.store.add_clip(file.stem, file.suffix)
    return studio.store.add_upload(kind.name, file.stem, file.suffix)


def _require(kind: Kind, part: Path, row: Clip | Upload) -> None:
    try:
        kind.look(part, row.path.with_suffix(".png") if isinstance(row, Clip) else row.preview)
    except GuiseError as error:
        why = f"{row.name} is no {kind.noun} that can be read: {kind.advice}"
        raise StudioError(why if kind is CLIP else explain(error)[0].replace(str(part), row.name)) from error


def _none_of(kinds: Sequence[Kind]) -> str:
    return f"no {' and no '.join(kind.noun for kind in kinds)}: {' Or '.join(kind.advice for kind in kinds)}"
