# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the dataset that a preset describes: `noisy-world generate` as a script, which needs no installation.

    python headless/generate.py presets/demo.yaml
    blender -b -P headless/generate.py -- presets/demo.yaml

Both take the same options and write the same dataset; the second runs inside a Blender program.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("generate", Path(__file__).resolve())
