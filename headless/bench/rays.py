# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine embree, a frame on disk, beside embreex's rays alone: seconds of processors, in pairs of turns.

    python headless/bench/rays.py [--mesh MESH.ply --trajectory TRAJ.txt] [--turns N]

Of a million quads, and of a mesh of one's own. Ratios are medians of the turns, with the distance from the least to the
largest, divided by the median.
"""

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

from bench.report import rays_alone, write_million
from bench.results import Results, Spread


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="rays.py", description="Measure engine embree beside embreex's rays alone.")
    parser.add_argument("--mesh", type=Path, help="a PLY file, beside the million quads")
    parser.add_argument("--trajectory", type=Path, help="its path, in Replica's format")
    parser.add_argument("--turns", type=int, default=6, help="of four frames each (default 6)")
    options = parser.parse_args(arguments)
    if (options.mesh is None) != (options.trajectory is None):
        parser.error("--mesh and --trajectory go together")
    results, scenes = Results({}), ["million"]
    with tempfile.TemporaryDirectory(prefix="noisy-world-bench-") as scratch:
        work = Path(scratch)
        write_million(work)
        if options.mesh is not None:
            scenes.append(options.mesh.stem)
            (work / f"{options.mesh.stem}.ply").symlink_to(options.mesh.resolve())
            (work / f"{options.mesh.stem}.txt").symlink_to(options.trajectory.resolve())
        for scene in scenes:
            found = rays_alone(work, scene, results, options.turns)
            if found is None:
                print(*results.notes, sep="\n", file=sys.stderr)
                return 1
            frame, bare, output = (
                Spread(**found[name]).text() for name in ("frame_core_s", "times_bare", "times_output")
            )
            print(f"{scene}: a frame on disk {frame} s, {bare} of bare rays, {output} of run(output=1); "
                  f"loading {found['loading_s']:.1f} s")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
