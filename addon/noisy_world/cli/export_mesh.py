# SPDX-License-Identifier: GPL-3.0-or-later
"""`export`: write a mesh as PLY in Replica's layout: an embedded room, or any mesh file that Noisy World reads.

Where faces have colours, each vertex is written once for each colour that meets there. Textures have no place in the
layout: they are written beside the file and named in it as MeshLab does. Many readers cannot read quads and other
polygons; --triangulate is for those.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from .command import Command
from .entry import Entry
from .parser import Parser
from .places import out_path, path

ENDING = ".ply"


def _export_options(parser: Parser) -> None:
    from ..core.scenes.embedded import EMBEDDED_ROOM, ROOMS

    known = f"a PLY, glTF, OBJ, USD, FBX or STL file, or {EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}"
    parser.add_argument("mesh", metavar="MESH", type=path, help=known)
    parser.add_argument(
        "out", metavar="OUT.ply", type=out_path, help="the file to write; one that is there is replaced"
    )
    up = "the axis of the file that points up, where that is not what the file declares; y is turned to Z up"
    parser.add_argument("--up", choices=("y", "z"), help=up)
    parser.add_argument("--triangulate", action="store_true", help="cut every polygon into triangles")


def _export(options: argparse.Namespace, _: Entry) -> int:
    """Write the mesh, and print what was written."""
    from ..core.errors import InputError
    from ..core.scenes.embedded import is_embedded
    from ..core.scenes.ply_file import read_header
    from ..core.scenes.ply_textured import write_textured_ply
    from ..core.scenes.ply_writer import write_ply
    from ..rooms import build_room
    from ..sources.mesh_reading import read_mesh

    if options.out.suffix.lower() != ENDING:
        problem = "its ending is not .ply, and PLY is what is written"
        raise InputError(options.out, problem, remedy=f"write {options.out.stem or 'mesh'}{ENDING}")
    name = str(options.mesh)
    if options.up is not None and is_embedded(name):
        raise InputError("--up", "goes with the file of a mesh", remedy="leave it out")
    mesh = build_room(_one_room(name)) if is_embedded(name) else read_mesh(options.mesh, options.up)
    pictures: Sequence[Path] = ()
    if mesh.texture is None:
        write_ply(options.out, mesh, triangulate=options.triangulate)
    else:
        pictures = write_textured_ply(options.out, mesh, mesh.texture, triangulate=options.triangulate)
    for note in mesh.notes:
        print(note)
    if pictures:
        print(f"wrote {', '.join(map(str, pictures))}: its textures, which Replica's layout has not")
    vertices = read_header(options.out).elements["vertex"].rows
    faces = int((mesh.face_sizes - 2).sum()) if options.triangulate else len(mesh.face_starts)
    print(f"wrote {options.out}: {vertices} vertices, {faces} faces")
    return 0


def _one_room(mesh: str) -> int:
    from ..core.errors import NoisyWorldError
    from ..core.scenes.embedded import MEANT, room_seeds

    try:
        seeds = room_seeds(mesh)
    except ValueError as error:
        raise NoisyWorldError(f"{error}; {MEANT}") from error
    if len(seeds) > 1:
        raise NoisyWorldError(f"{mesh} is {len(seeds)} rooms, and a file holds one; name one of them")
    return seeds[0]


EXPORT = Command(
    name="export",
    group="prepare and convert",
    help="write a mesh as PLY in Replica's layout",
    description="Write a mesh as PLY in Replica's layout.",
    options=_export_options,
    run=_export,
    needs=("numpy", "cv2"),
)
