"""Builds a GLB from a mesh of another format: triangles, normals, texture coordinates, colours, materials, pictures.

Quads become triangles and groups are dropped, as glTF has neither.
"""

from __future__ import annotations

import numpy as np

from guise.analogy.formats.documents import Document
from guise.analogy.formats.gltf_container import GL_ARRAY_BUFFER, GL_ELEMENT_ARRAY_BUFFER, GltfContainer, Json
from guise.analogy.formats.materials import Material
from guise.analogy.formats.polygons import Polygons
from guise.analogy.normals import finite_or_zero, polygon_vertex_normals, unit_vectors
from guise.common.arrays import F64, Int

SKIN_ROUGHNESS = 0.7  # for materials without one


def build_glb(
    source: Document, places: Int, materials: list[Material], material_ids: Int, *, turned: bool = False
) -> tuple[bytes, Int]:
    """A GLB, and (m,) the source vertex of each of its vertices.

    places : (n,) the same number for vertices split by a seam.   material_ids : (p,) of the polygons.
    turned : wind the faces the other way, as the source is inside out.
    """
    given = _corner_attributes(source, places, -1 if turned else 1)
    first, ids = _unique_corners([source.polygons.corners, *(rows for _, rows in given.values())])
    origin = source.polygons.corners[first]
    out = GltfContainer({"asset": {"version": "2.0", "generator": "guise"}}, bytearray())
    attributes = {"POSITION": _append_floats(out, source.vertices[origin])}
    attributes |= {name: _append_floats(out, values[rows[first]]) for name, (values, rows) in given.items()}
    if source.colours is not None:
        attributes["COLOR_0"] = _append_floats(out, _srgb_to_linear(source.colours[origin]))
    fans = source.polygons.fans[:, ::-1] if turned else source.polygons.fans
    of_fan = material_ids[source.polygons.owners[fans[:, 0]]]
    primitives = []
    for number in np.unique(of_fan).tolist():
        indices = out.append_accessor(
            ids[fans[of_fan == number]].reshape(-1, 1).astype(np.uint32), GL_ELEMENT_ARRAY_BUFFER
        )
        look = _append_material(out, materials[number])
        primitives.append({"attributes": dict(attributes), "indices": indices, "material": look})
    out.json |= {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "head"}],
        "meshes": [{"name": "head", "primitives": primitives}],
    }
    return out.to_glb(), origin


def _corner_attributes(source: Document, places: Int, side: int) -> dict[str, tuple[F64, Int]]:
    """Attributes that may differ between the corners of a vertex: unique values (k, d), and ids (c,) into them.

    side : -1 when the faces are inside out; normals are of the outer side.
    """
    corners = source.polygons.corners
    normals, ids = source.normals, source.normal_ids
    across_seams = Polygons(places[corners], source.polygons.sizes)
    outwards = side * polygon_vertex_normals(source.vertices, across_seams)[places]
    if normals is None or ids is None:
        normals, ids = outwards, corners
    elif (normals[ids] * outwards[corners]).sum() < 0:
        normals = -normals
    upright = np.where(normals.any(axis=1, keepdims=True), unit_vectors(normals), (0.0, 0.0, 1.0))
    found = {"NORMAL": _unique_rows(upright, ids)}
    if source.uvs is not None and source.uv_ids is not None:
        found["TEXCOORD_0"] = _unique_rows(source.uvs * (1, -1) + (0, 1), source.uv_ids)
    return found


def _unique_rows(values: F64, ids: Int) -> tuple[F64, Int]:
    """Unique values, and the ids into them."""
    alone, new = np.unique(values, axis=0, return_inverse=True)
    return alone, new.ravel()[ids]


def _unique_corners(columns: list[Int]) -> tuple[Int, Int]:
    """For corners (c,) with several ids each: one corner (m,) per combination, and the combinations (c,)."""
    kinds = columns[0]
    for column in columns[1:]:
        kinds = np.unique(kinds * (column.max() + 1) + column, return_inverse=True)[1]
    _, first, ids = np.unique(kinds, return_index=True, return_inverse=True)
    return first, ids


def _append_floats(out: GltfContainer, values: F64) -> int:
    return out.append_accessor(finite_or_zero(values).astype(np.float32), GL_ARRAY_BUFFER)


def _srgb_to_linear(colours: F64) -> F64:
    """Linear colours, as in glTF, from sRGB."""
    clipped = colours.clip(0, 1)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def _append_material(out: GltfContainer, material: Material) -> int:
    """Append a material; its index."""
    surface: Json = {
        "baseColorFactor": list(material.colour),
        "metallicFactor": 0.0,
        "roughnessFactor": SKIN_ROUGHNESS,
    }
    data = material.picture.read_bytes() if material.picture and material.picture.is_file() else b""
    kind = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
    mime = next((name for start, name in kind.items() if data.startswith(start)), None)
    if mime:
        out.entries("images").append({"bufferView": out.append_view(data), "mimeType": mime})
        out.entries("textures").append({"source": len(out.json["images"]) - 1})
        surface["baseColorTexture"] = {"index": len(out.json["textures"]) - 1}
    held: Json = {"pbrMetallicRoughness": surface, "doubleSided": True}
    if material.name:
        held["name"] = material.name
    if material.colour[3] < 1:
        held["alphaMode"] = "BLEND"
    out.entries("materials").append(held)
    return len(out.json["materials"]) - 1
