# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a mesh as PLY in Replica's layout: `noisy-world export` as a script, which needs no installation.

    python headless/export_mesh.py embedded:room room.ply
    python headless/export_mesh.py scan.ply triangles.ply --triangulate

Many readers cannot read quads and other polygons; --triangulate is for those.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("export", Path(__file__).resolve())
