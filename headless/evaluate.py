# SPDX-License-Identifier: GPL-3.0-or-later
"""Run SLAM systems and score them: `noisy-world evaluate` as a script, which needs no installation.

python headless/evaluate.py presets/benchmark.yaml --systems rgbd_odometry --out results
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("evaluate", Path(__file__).resolve())
