# SPDX-License-Identifier: GPL-3.0-or-later
"""List SLAM systems, and install them: `noisy-world systems` as a script, which needs no installation.

python headless/systems.py
python headless/systems.py install orb_slam3
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("systems", Path(__file__).resolve())
