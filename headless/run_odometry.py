# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow the camera through a dataset: `noisy-world run-odometry` as a script, which needs no installation.

python headless/run_odometry.py out/demo estimates
blender -b -P headless/run_odometry.py -- out/demo estimates --only "fog/*"
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("run-odometry", Path(__file__).resolve())
