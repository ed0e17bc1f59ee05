# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow the camera through a dataset: `noisy-world run-odometry` as a script, which needs no installation.

python headless/run_odometry.py out/demo estimates
blender -b -P headless/run_odometry.py -- out/demo estimates --only "fog/*"
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

    return command.run("run-odometry", arguments, entry(SCRIPT))


if __name__ == "__main__":
    end_with(main)
