# SPDX-License-Identifier: GPL-3.0-or-later
"""Python ends while the add-on is registered, as a script with the bpy module does that does not unregister it."""

import os
import subprocess
import sys

from worlds import ROOT


def test_a_script_that_does_not_unregister_ends_in_silence():
    script = "import bpy, noisy_world\nnoisy_world.register()\nprint('registered')"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "addon")}
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "registered" in result.stdout
    assert "Traceback" not in result.stdout + result.stderr
