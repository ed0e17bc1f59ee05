# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a mesh as PLY in Replica's layout: the embedded room, or any PLY that Noisy World reads.

    python headless/export_mesh.py embedded:room room.ply
    python headless/export_mesh.py scan.ply triangles.ply --triangulate

Quads and other polygons break many readers; --triangulate serves those.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "addon"))

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.presets.preset import EMBEDDED_ROOM
from noisy_world.core.scenes.ply import read_ply
from noisy_world.core.scenes.ply_writer import write_ply
from noisy_world.core.scenes.room import build_room


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="export_mesh.py", description="Write a mesh as PLY in Replica's layout.")
    parser.add_argument("mesh", metavar="MESH", help=f"a PLY file, or {EMBEDDED_ROOM}")
    parser.add_argument("out", metavar="OUT.ply", type=Path, help="the file to write; it is replaced if it is there")
    parser.add_argument("--triangulate", action="store_true", help="cut every polygon into triangles")
    options = parser.parse_args(arguments)
    try:
        mesh = build_room() if options.mesh == EMBEDDED_ROOM else read_ply(Path(options.mesh))
        write_ply(options.out, mesh, triangulate=options.triangulate)
    except NoisyWorldError as error:
        print(f"export_mesh.py: {error}", file=sys.stderr)
        return 1
    for note in mesh.notes:
        print(note)
    faces = int((mesh.face_sizes - 2).sum()) if options.triangulate else len(mesh.face_starts)
    print(f"wrote {options.out}: {len(mesh.vertices_m)} vertices, {faces} faces")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
