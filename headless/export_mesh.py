# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a mesh as PLY in Replica's layout: `noisy-world export` as a script, which needs no installation.

    python headless/export_mesh.py embedded:room room.ply
    python headless/export_mesh.py scan.ply triangles.ply --triangulate

Many readers cannot read quads and other polygons; --triangulate is for those.
"""

import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve()
# A Blender program does not import modules from the script's folder by itself.
sys.path.insert(0, str(SCRIPT.parent))

from installation import end_with, entry


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    from noisy_world.cli import command  # noqa: PLC0415 - importable only now

    return command.run("export", arguments, entry(SCRIPT))


if __name__ == "__main__":
    end_with(main)
