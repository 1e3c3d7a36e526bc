"""What the parts of a head are, in whole bodies too, and the file by which a user corrects it."""
# ruff: noqa: F811 (fixtures)

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mesh_work import HEAD, OTHER, SMILE, coarse, points, run, vertices  # noqa: F401
from test_lids import EYES, FACE_POINTS, HALF, ball, face, with_parts

from guise.aam.similarity import Failed
from guise.analogy.anatomy import (
    KINDS,
    FaceFrame,
    kind_by_name,
    kinds_by_place,
    name_components,
    with_components,
)
from guise.analogy.eyeballs import EyeTurns
from guise.analogy.feature_points import find_feature_points
from guise.analogy.formats.files import read_mesh
from guise.analogy.lids import FacePair
from guise.analogy.mesh import Mesh
from guise.analogy.parts import PartMotion
from guise.analogy.suspicions import has_second_face, has_slit
from guise.common.arrays import F64, Int

NAMES = {
    "glasses": ("Wolf3D_Glasses", "Sunglasses_Frame"), "lashes": ("AvatarLeftEyelashes", "FaceEyeline"),
    "brows": ("N00_000_00_FaceBrow_00_FACE", "Beard"), "eyeball": ("EyeLeft", "N00_000_00_EyeIris_00_EYE"),
    "hair": ("Wolf3D_Hair", "N00_000_Hair_00_HAIR"), "clothes": ("Wolf3D_Outfit_Top", "N00_002_03_Tops_01_CLOTH"),
    "tongue": ("M_Tongue",), "upper teeth": ("teethUpper", "Upper_Teeth"), "lower teeth": ("lower teeth",),
    "gums and cavity": ("FaceMouth", "Wolf3D_Teeth"), "body": ("Wolf3D_Body", "LeftHand"),
    None: ("", "default", "Mesh.001", "lambert1"),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, names in NAMES.items() for name in names])
def test_names_of_exporters_say_what_parts_are(kind: str | None, name: str) -> None:
    assert kind_by_name(name) == kind


def body(path: Path) -> tuple[str, dict[str, Int]]:
    """The other head on a body, with hair around it, a shirt and legs, as tall as people are; the parts' vertices."""
    head = vertices(OTHER)
    faces = [line for line in Path(OTHER).read_text().splitlines() if line.startswith("f ")]
    low, high = head.min(0), head.max(0)
    size, middle = high - low, (low + high) / 2
    hair = trimesh.creation.icosphere(4, 1.0)
    hair = hair.submesh(
        [(hair.triangles_center[:, 1] > 0.15) | (hair.triangles_center[:, 2] < -0.45)], append=True
    )
    pieces = {
        "Hair": (hair.vertices * (0.58, 0.6, 0.62) * size + middle, hair.faces),
        "Outfit_Top": box(middle - (0, 0.95 * size[1], 0), size * (1.6, 0.85, 0.9)),
        "Legs": box(middle - (0, 3.6 * size[1], 0), size * (1.4, 4.0, 0.8)),
    }
    lines = ["o Head", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in head), *faces]
    rows, count = {"Head": np.arange(len(head))}, len(head)
    for name, (at, corners) in pieces.items():
        lines += [f"o {name}", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in at)]
        lines += [f"f {' '.join(str(k + count + 1) for k in face)}" for face in corners.tolist()]
        rows[name], count = np.arange(count, count + len(at)), count + len(at)
    path.write_text("\n".join(lines) + "\n")
    return str(path), rows


def box(middle: F64, size: F64) -> tuple[F64, Int]:
    made = trimesh.creation.box(size).subdivide().subdivide()
    return made.vertices + middle, made.faces


@pytest.mark.slow
def test_of_a_whole_body_only_the_face_moves(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target, rows = body(here / "body.obj")
    code, out, err = run(
        capsys, "transfer", HEAD, SMILE, "--target", target, "-o", "made", "--report", "report.json"
    )
    assert (code, err) == (0, ""), err
    assert "parts of the target: " in out
    told = json.loads((here / "report.json").read_text())["parts"]
    assert {part["name"]: part["kind"] for part in told} == {
        "Head": "face skin", "Hair": "hair", "Outfit_Top": "clothes", "Legs": "body"
    }  # fmt: skip
    way = np.linalg.norm(vertices(here / "made" / "mean_smile.obj") - vertices(target), axis=1)
    assert max(way[rows[name]].max() for name in ("Hair", "Outfit_Top", "Legs")) < 1e-5
    own = np.linalg.norm(vertices(SMILE) - vertices(HEAD), axis=1).max()
    assert 0.7 * own < way[rows["Head"]].max() < 1.4 * own


@pytest.mark.slow
def test_a_file_of_parts_is_written_corrected_and_read(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    target, rows = body(here / "body.obj")
    code, out, _ = run(
        capsys,
        "landmarks",
        target,
        "--edit",
        points[1],
        "-o",
        "body.json",
        "--parts-out",
        "body.toml",
        "--force",
    )
    assert code == 0
    assert "body.toml: " in out
    text = (here / "body.toml").read_text()
    assert all(f'kind = "{kind}"' in text for kind in ("face skin", "hair", "clothes", "body"))
    (here / "mine.toml").write_text('[[part]]\nname = "Hair"\nkind = "other"\n')
    how = ("--landmarks", points[0], "body.json")
    code, _, err = run(
        capsys, "transfer", HEAD, SMILE, "--target", target, "-o", "a", *how, "--parts", "mine.toml"
    )
    assert (code, err) == (0, "")
    own = json.loads((here / "body.json").read_text())
    head = read_mesh(Path(target))
    at = np.array(list(own.values()))
    found = with_components(head.mesh, name_components(head.mesh, at, head.part_names), at)
    assert found.kinds is not None
    assert set(found.kinds[rows["Hair"]].tolist()) == {KINDS.index("hair")}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("part = 3", "must hold [[part]] tables"),
        ("[[part", "is not TOML"),
        ('[[part]]\nkind = "wig"\nname = "Head"', "a kind must be one of"),
        ('[[part]]\nkind = "hair"', "needs vertices or a name"),
        ('[[part]]\nkind = "hair"\nvertices = [-1]', "a vertex must be from 0"),
        ('[[part]]\nkind = "hair"\nvertices = "all"', "must be a list"),
        ('[[part]]\nkind = "hair"\nname = "Wig"', "no part is called 'Wig'"),
        ('[[part]]\nkind = "hair"\nvertices = [0]', "leaves no part of kind 'face skin'"),
    ],
)
def test_a_bad_file_of_parts_is_refused_in_one_sentence(
    text: str, said: str, here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "bad.toml").write_text(text)
    how = ("--landmarks", *points, "--parts", "bad.toml")
    code, _, err = run(capsys, "transfer", HEAD, SMILE, "--target", OTHER, "-o", "made", *how)
    assert code == 2
    assert said in err
    assert err.count("\n") == 1
    assert not (here / "made").exists()


def test_places_say_what_nameless_parts_are() -> None:
    skin = face(6, 1.0)[0]
    places = {
        "upper teeth": ball((0, -5.4, 1.2), 0.4), "lower teeth": ball((0, -6.6, 1.2), 0.4),
        "eyeball": ball((3, 0, 1.5), 1.5), "hair": ball((0, 9, 0), 6), "clothes": ball((0, -16, 0), 6),
    }  # fmt: skip
    mesh, rows = with_parts(skin, list(places.values()))
    named = kinds_by_place(
        mesh, FaceFrame.of(FACE_POINTS), np.arange(len(mesh.vertices)) < len(skin.vertices)
    )
    assert named.kinds is not None
    assert [KINDS[named.kinds[part[0]]] for part in rows] == list(places)


def test_soft_parts_bend_as_the_sources_do_and_teeth_keep_their_shape() -> None:
    skin = face(6, 1.0)[0]
    mesh, (cavity, tooth) = with_parts(skin, [ball((0, -6, 0.5), 2.4), ball((0.5, -5.4, 1.2), 0.4)])
    is_skin = np.arange(len(mesh.vertices)) < len(skin.vertices)
    way = np.zeros_like(mesh.vertices)
    for part in (cavity, tooth):
        below = part[mesh.vertices[part, 1] < mesh.vertices[part, 1].mean()]
        way[below] = (0, -1, -0.3)
    motion = PartMotion(mesh, is_skin, still=False, matched=~is_skin, face=FaceFrame.of(FACE_POINTS))
    made = motion(skin.vertices, way) - mesh.vertices
    np.testing.assert_allclose(made[cavity], way[cavity], atol=1e-9)
    edges = [
        np.linalg.norm(at[tooth, None] - at[tooth], axis=2) for at in (mesh.vertices, mesh.vertices + made)
    ]
    np.testing.assert_allclose(*edges, atol=1e-9)


def test_a_cavity_without_a_counterpart_hangs_between_the_jaws() -> None:
    frame = FaceFrame.of(FACE_POINTS)
    places = frame.mouth + np.array([[1.0], [0], [-1]]) * frame.axes[1]
    np.testing.assert_allclose(frame.lower_share(places), [0, 0.5, 1], atol=1e-6)


def tube(length: float, rings: int, sides: int = 12) -> tuple[F64, Int]:
    """A tube that begins behind the lips, ring after ring."""
    angle, back = np.meshgrid(2 * np.pi * np.arange(sides) / sides, np.linspace(0, length, rings))
    at = np.stack([1.2 * np.cos(angle), 1.2 * np.sin(angle) - 6, 2.0 - back], axis=2).reshape(-1, 3)
    first = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).ravel()
    after = first + np.where(first % sides == sides - 1, 1 - sides, 1)
    return at, np.stack([first, after, after + sides, first + sides], axis=1)


def test_the_wall_of_a_cavity_goes_with_the_lips_in_front_and_with_the_skull_behind() -> None:
    skin = face(6, 1.0)[0]
    mesh, (wall,) = with_parts(skin, [tube(3.0, 9)])
    is_skin = np.arange(len(mesh.vertices)) < len(skin.vertices)
    moved = skin.vertices.copy()
    moved[skin.vertices[:, 1] < -6] += (0, -1, -0.3)
    motion = PartMotion(mesh, is_skin, still=False, matched=None, face=FaceFrame.of(FACE_POINTS))
    drop = (mesh.vertices - motion(moved, np.zeros_like(mesh.vertices)))[wall][:, 1].reshape(9, 12)
    np.testing.assert_allclose(drop[0, 7:12], 1, atol=1e-6)
    np.testing.assert_allclose(drop[0, 1:6], 0, atol=1e-6)
    np.testing.assert_allclose(drop[-1], 0, atol=1e-6)
    assert np.abs(np.diff(drop[:, 9])).max() < 0.4  # nowhere torn


def turned(degrees: float) -> F64:
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def test_eyeballs_turn_about_their_own_centres_and_never_leave_them() -> None:
    """Whatever else the source's do; the target is larger."""
    skin, frame = face(6, 1.0)[0], FaceFrame.of(FACE_POINTS)
    meshes, rows = zip(
        *(with_parts(skin, [ball((x, 0, 1.5), size) for x in EYES]) for size in (1.4, 1.8)), strict=True
    )
    named = [
        kinds_by_place(mesh, frame, np.arange(len(mesh.vertices)) < len(skin.vertices)) for mesh in meshes
    ]
    shown = named[0].vertices.copy()
    for part, middle in zip(rows[0], EYES, strict=True):
        shown[part] = (shown[part] - (middle, 0, 1.5)) @ turned(20).T + (middle, 0, 1.5) + (0, 0.3, 0)
    made = EyeTurns(*named, (frame, frame), np.eye(3))(shown, named[1].vertices.copy())
    for part, middle in zip(rows[1], EYES, strict=True):
        centre = np.array([middle, 0, 1.5])
        np.testing.assert_allclose(
            made[part], (named[1].vertices[part] - centre) @ turned(20).T + centre, atol=1e-6
        )


def test_lashes_follow_the_margin_at_which_they_begin() -> None:
    """Their tips lie over the skin of the upper lid, which moves less."""
    mesh, shut, _ = face(8, 1.0)
    x = np.repeat(np.linspace(2.2, 3.8, 9), 2)
    root = 0.5 * (1 - ((x - 3) / HALF) ** 2)
    tip = np.tile([0.0, 1.0], 9)
    card = np.column_stack([x, root + 0.5 * tip, 3.05 - 0.02 * x**2 + 0.3 * tip])
    quads = np.array([[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(8)])
    whole, (lashes,) = with_parts(mesh, [(card, quads)])
    skin = np.arange(len(whole.vertices)) < len(mesh.vertices)
    kinds = np.where(skin, KINDS.index("face skin"), KINDS.index("lashes"))
    pair = FacePair.of(whole.with_kinds(kinds), whole.with_kinds(kinds), (FACE_POINTS, FACE_POINTS))
    motion = PartMotion(
        whole.with_kinds(kinds), skin, still=False, face=FaceFrame.of(FACE_POINTS), margins=pair.margins(whole.vertices)
    )  # fmt: skip
    way = motion(shut, np.zeros_like(whole.vertices))[lashes] - card
    np.testing.assert_allclose(way[1::2], way[::2], atol=0.2)  # tips as roots
    np.testing.assert_allclose(way[::2, 1][2:-2], -2 * root[::2][2:-2], rtol=0.25)


@pytest.mark.slow
def test_a_second_face_and_lips_of_one_piece_are_seen() -> None:
    mesh = read_mesh(Path(OTHER)).mesh
    found = find_feature_points(mesh)
    assert not isinstance(found, Failed)
    own = found.positions
    frame = FaceFrame.of(own)
    assert not has_second_face(mesh, frame)
    both = [mesh.vertices, mesh.vertices + np.array([2.5, 0, 0])]
    assert has_second_face(
        Mesh.of_triangles(
            np.concatenate(both), np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)])
        ),
        frame,
    )
    assert has_slit(mesh, own)
    across, up = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    sheet = frame.mouth + frame.mouth_width * (
        across[..., None] * frame.axes[0] + up[..., None] * frame.axes[1]
    )
    ids = np.arange(21 * 21).reshape(21, 21)
    quads = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1).reshape(-1, 4)
    assert not has_slit(Mesh(sheet.reshape(-1, 3), np.empty((0, 3), np.intp), quads), own)
