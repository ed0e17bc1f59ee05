# SPDX-License-Identifier: GPL-3.0-or-later
"""ORB-SLAM2 or ORB-SLAM3 as it was built from source, on a sequence: settings and frames for its driver, which follows.

    .venv-orb-slam2/bin/python orb_slam_built.py 2|3 FRAMES OUT ENVIRONMENT --mono | OPTIONS OF DEPTH
    .venv-orb-slam2/bin/python orb_slam_built.py --versions ENVIRONMENT

The settings are those of orb_slam3.py, in the format of each. It ends as orb_slam/driver.cc does, which it becomes.
"""

import argparse
import hashlib
import json
import os
import sys
from pathlib import Path

from orb_settings import add_options, gap_of, settings_text, settings_text_2

VOCABULARY = "orb_vocabulary.txt"


def main(arguments: list[str]) -> None:
    """Run the command line."""
    if arguments[:1] == ["--versions"]:
        print(json.dumps(versions(Path(arguments[1]))))
        return
    parser = argparse.ArgumentParser(prog="orb_slam_built.py", description="Run ORB-SLAM, built from source.")
    parser.add_argument("generation", choices=("2", "3"), help="which ORB-SLAM")
    parser.add_argument("frames", type=Path, help="the index of the frames")
    parser.add_argument("out", type=Path, help="the folder to write into")
    parser.add_argument("environment", type=Path, help="the folder that it was built into")
    add_options(parser)
    options = parser.parse_args(arguments)
    index = json.loads(options.frames.read_text(encoding="utf-8"))
    settings, frames = options.out / "orb_slam.yaml", options.out / "frames.tsv"
    text = settings_text(index, options) if options.generation == "3" else settings_text_2(index, options)
    settings.write_text(text, encoding="utf-8")
    frames.write_text(frames_text(index, mono=options.mono), encoding="utf-8")
    program = options.environment / "bin" / "orb_slam"
    words = [program, options.environment / VOCABULARY, settings, frames, options.out]
    os.execv(program, [str(word) for word in words])  # noqa: S606 - our own


def frames_text(index: dict, *, mono: bool) -> str:
    """Return the list of frames that driver.cc reads. A path with a tab or a line feed ends the program with a line."""
    rows = [f"{'mono' if mono else 'rgbd'} {index['depth_scale_per_m']!r} {gap_of(index)!r}\n"]
    for frame in index["frames"]:
        words = [repr(frame["stamp_s"]), frame["colour"], "" if mono else frame["depth"]]
        if any(mark in word for word in words for mark in "\t\n\r"):
            sys.exit(f"orb_slam_built.py: {frame['colour']!r} has a tab or a line feed in its name; rename its folder")
        rows.append("\t".join(words) + "\n")
    return "".join(rows)


def versions(environment: Path) -> dict[str, str]:
    """Return what was built, and which vocabulary it has."""
    built = environment / "built.json"
    if not built.is_file() or not os.access(environment / "bin" / "orb_slam", os.X_OK):
        sys.exit(f"{environment} was not built to its end")
    digest = hashlib.sha256((environment / VOCABULARY).read_bytes()).hexdigest()
    return json.loads(built.read_text(encoding="utf-8")) | {"vocabulary": f"orb_vocabulary, sha256 {digest[:16]}"}


if __name__ == "__main__":
    main(sys.argv[1:])
