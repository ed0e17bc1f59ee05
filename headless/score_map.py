# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare a map with the true scene: `noisy-world score-map` as a script, which needs no installation.

python headless/score_map.py map.ply embedded:room --sequence out/clean/room
python headless/score_map.py run_folder out/clean/room --json
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("score-map", Path(__file__).resolve())
