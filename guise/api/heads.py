"""Expressions between 3-D heads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Unpack

from guise.api.options import AnyPath, WatchOptions
from guise.api.pictures import path_of, paths
from guise.api.vocabulary import call, watch_of

if TYPE_CHECKING:
    from guise.app.meshes.context import RunContext
    from guise.app.meshes.options import TransferOptions
    from guise.app.meshes.reports import (
        LandmarksReport,
        MeshReport,
        PreviewReport,
        RegisterReport,
        TransferReport,
    )

R = TypeVar("R", bound="MeshReport")


class MeshOptions(WatchOptions, total=False):
    """What is written besides.   picture : of the heads.   overwrite : replace existing outputs."""

    picture: AnyPath | None
    overwrite: bool


class RegisterMeshOptions(MeshOptions, total=False):
    """The same, with a report in JSON and how heads are matched.

    landmarks : files of feature points of both heads, or "auto".
    """

    report: AnyPath | None
    landmarks: tuple[str, str] | None


class TransferMeshOptions(RegisterMeshOptions, total=False):
    """How expressions are transferred.

    method : vertex "tents", or what they are compared with.   correspondence : how the heads are matched.
    guides : "none", or "contours" of cheeks, jaw and neck.   parts : a file of what the parts of the target are.
    keep_rigid : keep eyes, teeth and other parts in place.
    """

    method: Literal["tents", "gradients", "cloning"]
    correspondence: Literal["dense", "cylinder"]
    guides: Literal["contours", "none"]
    parts: AnyPath | None
    keep_rigid: bool


@call
def transfer_mesh(
    neutral: AnyPath,
    expressions: AnyPath | Sequence[AnyPath],
    target: AnyPath,
    output: AnyPath | None = None,
    **options: Unpack[TransferMeshOptions],
) -> TransferReport:
    """Carry expressions of one 3-D head over to another of any topology.

    Parameters
    ----------
    neutral, expressions : mesh files (OBJ, PLY, glTF, GLB, VRM) of one head, at rest and moved: same vertices.
    target : the mesh file of another head, at rest.
    output : folder for one file per expression, in the target's format; by default TARGET_expressions beside it.
    options : `TransferMeshOptions`.
    """
    from guise.app.meshes.transferring import transfer_files

    how, left = _transfer(options)
    return _run(
        lambda work: transfer_files(
            Path(neutral), paths(expressions), Path(target), path_of(output), how, work
        ),
        left,
    )


@call
def transfer_rig(
    source: AnyPath,
    target: AnyPath,
    output: AnyPath,
    *,
    unit: Literal["m", "dm", "cm", "mm", "in"] | None = None,
    author: str | Sequence[str] = (),
    **options: Unpack[TransferMeshOptions],
) -> TransferReport:
    """Carry all morph targets of a head (.glb, .gltf, .vrm) over to another, with their names.

    output : the target with them, a .glb or .vrm.   unit : of the target's lengths, scaled to metres.
    author : who made the target, one or several, for a .vrm made of another format.
    """
    from guise.app.meshes.transferring import transfer_rig as transfer

    how, left = _transfer(options)
    names = (author,) if isinstance(author, str) else author
    return _run(lambda work: transfer(Path(source), Path(target), Path(output), how, work, unit, names), left)


@call
def transfer_sequence(
    neutral: AnyPath,
    frames: AnyPath,
    target: AnyPath,
    output: AnyPath,
    *,
    fps: float | None = None,
    resume: bool = False,
    unit: Literal["m", "dm", "cm", "mm", "in"] | None = None,
    **options: Unpack[TransferMeshOptions],
) -> TransferReport:
    """Carry an animation of one head over to another, frame by frame.

    frames : a folder of .obj or .ply files, or a .glb with animated morph targets.   output : such a folder or .glb.
    resume : go on where an earlier run stopped.
    """
    from guise.app.meshes.sequences import SequenceFiles
    from guise.app.meshes.sequences import transfer_sequence as transfer

    how, left = _transfer(options)
    files = SequenceFiles(Path(frames), Path(output), fps, resume, unit)
    return _run(lambda work: transfer(Path(neutral), files, Path(target), how, work), left)


@call
def register_mesh(
    template: AnyPath, target: AnyPath, output: AnyPath | None = None, **options: Unpack[RegisterMeshOptions]
) -> RegisterReport:
    """Deform a head onto another, and write the correspondence of their vertices beside the deformed head."""
    from guise.app.meshes.registering import register_files

    left: dict[str, Any] = {**options}
    points = left.pop("landmarks", None)
    return _run(
        lambda work: register_files(Path(template), Path(target), path_of(output), points, work), left
    )


@call
def mesh_landmarks(
    head: AnyPath,
    output: AnyPath | None = None,
    *,
    edit: AnyPath | None = None,
    template: AnyPath | None = None,
    template_landmarks: str = "auto",
    parts_out: AnyPath | None = None,
    **options: Unpack[MeshOptions],
) -> LandmarksReport:
    """Find the 20 feature points (MPEG-4) of a head.

    output : the file, by default HEAD.landmarks.json.   edit : a file of corrected points.
    template : a head by whose points, or template_landmarks, they are refined.   parts_out : what its parts are.
    """
    from guise.app.meshes.points import write_feature_points

    like = None if template is None else (Path(template), template_landmarks)
    return _run(
        lambda work: write_feature_points(
            Path(head), path_of(output), path_of(edit), like, path_of(parts_out), work
        ),
        {**options},
    )


@call
def preview_mesh(
    head: AnyPath,
    after: AnyPath | None = None,
    output: AnyPath | None = None,
    *,
    truth: AnyPath | None = None,
    overwrite: bool = False,
) -> PreviewReport:
    """Draw a head from several sides or as a turntable video, or two with the same vertices and their distances.

    truth : what `after` should be, to draw its error E in three bands (Song et al. 2007, figure 11).
    """
    from guise.app.meshes.previewing import preview_files

    return _run(
        lambda work: preview_files(Path(head), path_of(after), path_of(output), work, path_of(truth)),
        {"overwrite": overwrite},
    )


def _transfer(options: TransferMeshOptions) -> tuple[TransferOptions, dict[str, Any]]:
    """How to transfer, and the options that are left."""
    from guise.app.meshes.options import TransferOptions

    left: dict[str, Any] = {**options}
    if left.get("parts") is not None:
        left["parts"] = Path(left["parts"])
    names = ("method", "correspondence", "guides", "landmarks", "parts", "keep_rigid")
    return TransferOptions(**{name: left.pop(name) for name in names if name in left}), left


def _run(do: Callable[[RunContext], R], left: dict[str, Any]) -> R:
    """Do it, and write its report if that is asked for."""
    from guise.app.meshes.context import RunContext
    from guise.common.files import write_json
    from guise.common.threads import one_thread

    progress, say = watch_of(left)
    picture, report = path_of(left.get("picture")), path_of(left.get("report"))
    with one_thread():
        done = do(RunContext(left.get("overwrite", False), progress, say, picture, report))
    if report is not None:
        write_json(report, done.as_json())
    return done
