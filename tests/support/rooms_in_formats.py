# SPDX-License-Identifier: GPL-3.0-or-later
"""One textured cube room as files of several formats, each written here by hand, and glTF documents of any content."""

import base64
import json
import struct
import zlib

import cv2
import numpy as np
from ply_files import XYZ, ply, vertex

LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.5, 1.75, 2.5])
TILES = np.random.default_rng(5).integers(0, 256, (2, 3, 3)).astype(np.uint8)  # a colour for each wall
PICTURE = TILES.repeat(8, axis=0).repeat(8, axis=1)
QUAD = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
IDENTITY = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # Z up as glTF stores it
MATERIAL = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}


def walls():
    """The corners (6, 4, 3) of the walls and their texture coordinates (6, 4, 2): a tile of the picture for each."""
    corners, uv = [], []
    for number in range(6):
        axis, side = divmod(number, 2)
        others = [(axis + 1) % 3, (axis + 2) % 3]
        unit = np.empty((4, 3))
        unit[:, axis], unit[:, others] = side, QUAD
        corners.append(LOW + unit * (HIGH - LOW))
        row, column = divmod(number, 3)
        uv.append((np.array([column, 1 - row]) + QUAD) / (3, 2))
    return np.array(corners), np.array(uv)


def write_picture(folder, name="walls.png"):
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / name), PICTURE[..., ::-1])
    return folder / name


def write_ply(folder):
    corners, uv = walls()
    faces = [(tuple(range(4 * n, 4 * n + 4)), tuple(uv[n].ravel().tolist())) for n in range(6)]
    declared = ("list uchar int vertex_indices", "list uchar float texcoord")
    rows = [tuple(point) for point in corners.reshape(-1, 3).tolist()]
    elements = (vertex(XYZ, rows), ("face", declared, faces))
    write_picture(folder)
    (folder / "room.ply").write_bytes(ply("ascii", *elements, extra=("comment TextureFile walls.png",)))
    return folder / "room.ply"


def write_obj(folder, turn=IDENTITY):
    corners, uv = walls()
    lines = ["mtllib room.mtl", "o room", "usemtl walls"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in (corners.reshape(-1, 3) @ turn.T).tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.reshape(-1, 2).tolist()]
    lines += ["f " + " ".join(f"{n}/{n}" for n in range(4 * wall + 1, 4 * wall + 5)) for wall in range(6)]
    write_picture(folder)
    (folder / "room.mtl").write_text("newmtl walls\nKd 0.5 0.5 0.5\nmap_Kd walls.png\n")
    (folder / "room.obj").write_text("\n".join([*lines, ""]))
    return folder / "room.obj"


def write_usda(folder, turn=IDENTITY, up="Z", metres_per_unit=1.0):
    corners, uv = walls()
    points = ", ".join(str(tuple(each)) for each in (corners.reshape(-1, 3) @ turn.T / metres_per_unit).tolist())
    coordinates = ", ".join(str(tuple(each)) for each in uv.reshape(-1, 2).tolist())
    write_picture(folder)
    path = folder / "room.usda"
    path.write_text(
        f"""#usda 1.0
( metersPerUnit = {metres_per_unit}
  upAxis = "{up}" )
def Xform "World" {{
  def Mesh "Room" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    int[] faceVertexCounts = {[4] * 6}
    int[] faceVertexIndices = {list(range(24))}
    point3f[] points = [{points}]
    texCoord2f[] primvars:st = [{coordinates}] ( interpolation = "faceVarying" )
    uniform token subdivisionScheme = "none"
    rel material:binding = </World/Look>
  }}
  def Material "Look" {{
    token outputs:surface.connect = </World/Look/Shader.outputs:surface>
    def Shader "Shader" {{
      uniform token info:id = "UsdPreviewSurface"
      color3f inputs:diffuseColor.connect = </World/Look/Picture.outputs:rgb>
      token outputs:surface
    }}
    def Shader "Picture" {{
      uniform token info:id = "UsdUVTexture"
      asset inputs:file = @walls.png@
      token inputs:wrapS = "repeat"
      token inputs:wrapT = "repeat"
      float2 inputs:st.connect = </World/Look/Coordinates.outputs:result>
      float3 outputs:rgb
    }}
    def Shader "Coordinates" {{
      uniform token info:id = "UsdPrimvarReader_float2"
      token inputs:varname = "st"
      float2 outputs:result
    }}
  }}
}}
"""
    )
    return path


def write_stl(folder):
    corners, _ = walls()
    triangles = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 9)
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *each, 0) for each in triangles.tolist())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "room.stl").write_bytes(b"by hand".ljust(80) + struct.pack("<I", len(triangles)) + facets)
    return folder / "room.stl"


def room_attributes():
    """The room's triangles as glTF has them: positions (36, 3), Y up, and texture coordinates, from the top left."""
    corners, uv = walls()
    order = [0, 1, 2, 0, 2, 3]
    positions = (corners[:, order] @ TO_Y_UP.T).reshape(-1, 3)
    return {"POSITION": positions, "TEXCOORD_0": uv[:, order].reshape(-1, 2) * (1, -1) + (0, 1)}


def gltf(attributes, material=None, *, images=(), samplers=(), nodes=None, **keys):
    """A glTF document of one primitive, and its buffer. images: the bytes of PNG files."""
    views, accessors, blob = [], [], b""
    for name, values in attributes.items():
        data = np.ascontiguousarray(values, "<f4")
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes})
        kind = {2: "VEC2", 3: "VEC3", 4: "VEC4"}[data.shape[1]]
        limits = {"min": data.min(0).tolist(), "max": data.max(0).tolist()} if name == "POSITION" else {}
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": 5126, "count": len(data), "type": kind} | limits
        )
        blob += data.tobytes()
    listed = []
    for data in images:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        listed.append({"bufferView": len(views) - 1, "mimeType": "image/png"})
        blob += data + b"\0" * (-len(data) % 4)
    primitive = {"attributes": {name: number for number, name in enumerate(attributes)}}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}] if nodes is None else nodes,
        "meshes": [{"primitives": [primitive if material is None else primitive | {"material": 0}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    if material is not None:
        document["materials"] = [material]
    if listed:
        document["images"] = listed
        textures = [{"source": number} for number in range(len(listed))]
        document["textures"] = [{**each, "sampler": 0} if samplers else each for each in textures]
    if samplers:
        document["samplers"] = list(samplers)
    return document | keys, blob


def glb(document, blob):
    """The bytes of a GLB file."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def png(picture):
    return cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))[1].tobytes()


def black_png(width_px, height_px):
    """A whole PNG of black pixels, one bit each, of a few bytes."""
    packer = zlib.compressobj(9)
    row = bytes(1 + (width_px + 7) // 8)
    data = b"".join(packer.compress(row) for _ in range(height_px)) + packer.flush()
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width_px, height_px, 1, 0, 0, 0, 0)), (b"IDAT", data), (b"IEND", b"")]
    written = [struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
               for name, body in parts]  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(written)


def write_glb(folder):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "room.glb").write_bytes(glb(*gltf(room_attributes(), MATERIAL, images=[png(PICTURE)])))
    return folder / "room.glb"


def write_gltf(folder, *, embedded=False):
    """As files of their own: the document, its buffer and the picture; embedded: the buffer in the document."""
    document, blob = gltf(room_attributes(), MATERIAL, images=[])
    write_picture(folder)
    (folder / "the room.bin").write_bytes(blob)
    uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode() if embedded else "the%20room.bin"
    document["buffers"][0]["uri"] = uri
    document |= {"images": [{"uri": "walls.png"}], "textures": [{"source": 0}]}
    (folder / "room.gltf").write_text(json.dumps(document))
    return folder / "room.gltf"
