# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare an estimated trajectory with the true one: `noisy-world score` as a script, which needs no installation.

python headless/score.py estimate.txt groundtruth.txt
python headless/score.py run_folder sequence_folder --protocol paper --json
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("score", Path(__file__).resolve())
