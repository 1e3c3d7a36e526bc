"""A GLB made of a mesh of another format: triangles, normals, texture coordinates, colours, materials, pictures.

Quads become triangles and groups are dropped, for glTF has neither.
"""

from __future__ import annotations

import numpy as np

from guise.analogy.formats.documents import Document
from guise.analogy.formats.gltf_container import INDICES, VERTICES, Container, Json
from guise.analogy.formats.materials import Material
from guise.analogy.formats.polygons import Polygons
from guise.analogy.normals import smooth, sound, unit
from guise.common.arrays import F64, Int

ROUGHNESS = 0.7  # of skin, for materials that say nothing of it


def made_glb(
    source: Document, places: Int, materials: list[Material], material_ids: Int
) -> tuple[bytes, Int]:
    """A GLB, and (m,) the vertex of the source that each of its vertices is.

    places : (n,) the same for vertices that a seam splits.   material_ids : (p,) of the polygons.
    """
    given = _of_corners(source, places)
    first, ids = _distinct([source.polygons.corners, *(rows for _, rows in given.values())])
    origin = source.polygons.corners[first]
    out = Container({"asset": {"version": "2.0", "generator": "guise"}}, bytearray())
    attributes = {"POSITION": _floats(out, source.vertices[origin])}
    attributes |= {name: _floats(out, values[rows[first]]) for name, (values, rows) in given.items()}
    if source.colours is not None:
        attributes["COLOR_0"] = _floats(out, _linear(source.colours[origin]))
    fans = source.polygons.fans
    of_fan = material_ids[source.polygons.owners[fans[:, 0]]]
    primitives = []
    for number in np.unique(of_fan).tolist():
        indices = out.append(ids[fans[of_fan == number]].reshape(-1, 1).astype(np.uint32), INDICES)
        look = _material(out, materials[number])
        primitives.append({"attributes": dict(attributes), "indices": indices, "material": look})
    out.json |= {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "head"}],
        "meshes": [{"name": "head", "primitives": primitives}],
    }
    return out.glb(), origin


def _of_corners(source: Document, places: Int) -> dict[str, tuple[F64, Int]]:
    """Attributes that a vertex may have several of: the values (k, d), none twice, and which one a corner (c,) has."""
    corners = source.polygons.corners
    normals, ids = source.normals, source.normal_ids
    if normals is None or ids is None:
        across_seams = Polygons(places[corners], source.polygons.sizes)
        normals, ids = smooth(source.vertices, across_seams)[places], corners
    upright = np.where(normals.any(axis=1, keepdims=True), unit(normals), (0.0, 0.0, 1.0))
    found = {"NORMAL": _merged(upright, ids)}
    if source.uvs is not None and source.uv_ids is not None:
        found["TEXCOORD_0"] = _merged(source.uvs * (1, -1) + (0, 1), source.uv_ids)
    return found


def _merged(values: F64, ids: Int) -> tuple[F64, Int]:
    """The values without repetitions, and the ids of those."""
    alone, new = np.unique(values, axis=0, return_inverse=True)
    return alone, new.ravel()[ids]


def _distinct(columns: list[Int]) -> tuple[Int, Int]:
    """Of corners (c,) with several ids each: one of each kind (m,), in the order of the first ids; the kinds (c,)."""
    kinds = columns[0]
    for column in columns[1:]:
        kinds = np.unique(kinds * (column.max() + 1) + column, return_inverse=True)[1]
    _, first, ids = np.unique(kinds, return_index=True, return_inverse=True)
    return first, ids


def _floats(out: Container, values: F64) -> int:
    return out.append(sound(values).astype(np.float32), VERTICES)


def _linear(colours: F64) -> F64:
    """Colours as glTF wants them, from those of sRGB."""
    clipped = colours.clip(0, 1)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def _material(out: Container, material: Material) -> int:
    """The id of a material put into the document."""
    surface: Json = {
        "baseColorFactor": list(material.colour),
        "metallicFactor": 0.0,
        "roughnessFactor": ROUGHNESS,
    }
    data = material.picture.read_bytes() if material.picture and material.picture.is_file() else b""
    kind = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
    mime = next((name for start, name in kind.items() if data.startswith(start)), None)
    if mime:
        out.entries("images").append({"bufferView": out.append_bytes(data), "mimeType": mime})
        out.entries("textures").append({"source": len(out.json["images"]) - 1})
        surface["baseColorTexture"] = {"index": len(out.json["textures"]) - 1}
    held: Json = {"pbrMetallicRoughness": surface, "doubleSided": True}
    if material.name:
        held["name"] = material.name
    if material.colour[3] < 1:
        held["alphaMode"] = "BLEND"
    out.entries("materials").append(held)
    return len(out.json["materials"]) - 1
