# SPDX-License-Identifier: GPL-3.0-or-later
"""Let chance use Blender's window with the add-on on, and tell what went wrong.

    python headless/tools/random_window.py BLENDER [--seed 0] [--minutes 5] [--actions N] [--folder FOLDER]

BLENDER: a Blender program that opens its window somewhere. Each seed is a run of its own until the minutes are over.
An exit, a traceback, and data of the user's that the add-on changed are told with the seed and the action; then the
exit status is 1. The same seed draws the same actions as long as Blender does the same with them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tests" / "ui" / "window" / "random_actions.py"
SLOWEST = 12  # actions that are told
TRACEBACK = "Traceback (most recent call last)"


@dataclass(frozen=True)
class Run:
    """What came of one seed. actions: lines of actions.jsonl. said: what Blender printed. code: its exit status."""

    seed: int
    actions: list[dict[str, Any]]
    said: str
    code: int

    @property
    def failures(self) -> list[str]:
        """What went wrong, each in one line or a traceback."""
        found = [f"{item['done']}: changed: {', '.join(item['wrong'])}" for item in self.actions if item.get("wrong")]
        found += [f"{item['done']}: {item['result']}" for item in self.actions if "Traceback" in item.get("result", "")]
        if TRACEBACK in self.said:
            found.append(self.said[self.said.index(TRACEBACK) :][:1500])
        if not any("over" in item for item in self.actions):
            found.append(f"Blender ended with {self.code} after: {self.actions[-1:]}\n{self.said[-1500:]}")
        return found

    def slowest(self) -> Iterator[str]:
        """Yield the actions that held the window longest, and after which the windows took longest to draw."""
        named = {item["number"]: f"{item['action']} {item['words']}" for item in self.actions if "number" in item}
        for kind, clock in (("done", "s"), ("after", "drawn_s")):
            lines = [item for item in self.actions if kind in item]
            for item in sorted(lines, key=lambda item: -item["cpu_s"])[:SLOWEST]:
                yield f"{kind} {item['cpu_s']:.2f} s by the thread, {item[clock]:.2f} s: {named[item[kind]][:150]}"


def box_ply() -> str:
    """Return a mesh of a room without ceiling, with a colour at each vertex."""
    corners = [(x, y, z) for z in (0, 2.5) for y in (-2, 2) for x in (-3, 3)]
    faces = [(0, 1, 3, 2), (0, 4, 5, 1), (1, 5, 7, 3), (3, 7, 6, 2), (2, 6, 4, 0)]
    head = f"""ply
format ascii 1.0
element vertex {len(corners)}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    lines = [f"{x} {y} {z} {60 * k % 256} {90 * k % 256} 200" for k, (x, y, z) in enumerate(corners)]
    return head + "\n".join([*lines, *(f"4 {' '.join(map(str, face))}" for face in faces)]) + "\n"


def run(blender: str, seed: int, minutes: float, folder: Path, most: int = 0) -> Run:
    """Let one seed use a window in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "mesh.ply").write_text(box_ply())
    poses = [[1, 0, 0, 0.1 * k, 0, 1, 0, 0, 0, 0, 1, 1.0, 0, 0, 0, 1] for k in range(5)]
    (folder / "trajectory.txt").write_text("\n".join(" ".join(map(str, pose)) for pose in poses) + "\n")
    words = [blender, "-P", SCRIPT, "--", folder, ROOT / "addon", seed, minutes, *([most] if most else [])]
    places = {"BLENDER_USER": str(folder / "profile"), "BLENDER_USER_RESOURCES": str(folder / "profile")}
    with (folder / "said.txt").open("w") as said:
        done = subprocess.run(
            list(map(str, words)),
            stdout=said,
            stderr=subprocess.STDOUT,
            check=False,
            cwd=folder,
            env=os.environ | places | {"SCREEN": "800x600x24"},
        )
    lines = (folder / "actions.jsonl").read_text().splitlines() if (folder / "actions.jsonl").exists() else []
    return Run(
        seed, [json.loads(line) for line in lines], (folder / "said.txt").read_text(errors="replace"), done.returncode
    )


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="random_window.py", description="Use Blender's window by chance.")
    parser.add_argument("blender", help="a Blender program that opens its window somewhere")
    parser.add_argument("--seed", type=int, default=0, help="the first seed (default 0)")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds, one after another (default 1)")
    parser.add_argument("--minutes", type=float, default=5, help="of each seed (default 5)")
    parser.add_argument("--actions", type=int, default=0, help="stop after so many (default: the minutes decide)")
    parser.add_argument("--folder", type=Path, help="to keep what came of it (default: none)")
    options = parser.parse_args(arguments)
    wrong = False
    for seed in range(options.seed, options.seed + options.seeds):
        with tempfile.TemporaryDirectory() as scratch:
            folder = (options.folder or Path(scratch)) / f"seed{seed}"
            result = run(options.blender, seed, options.minutes, folder, options.actions)
        print(f"seed {seed}: {sum('done' in item for item in result.actions)} actions, {len(result.failures)} failures")
        for line in result.failures:
            print(f"  {line}")
        for line in result.slowest():
            print(f"  {line}")
        sys.stdout.flush()
        wrong = wrong or bool(result.failures)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
