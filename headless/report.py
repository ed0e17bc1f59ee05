# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the report of a study anew: `noisy-world report` as a script, which needs no installation.

python headless/report.py out/study-results
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # a Blender program does not

from installation import run_subcommand

if __name__ == "__main__":
    run_subcommand("report", Path(__file__).resolve())
