# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process tells of itself."""

import subprocess
import sys

import numpy as np
import pytest
from worlds import ROOT

from noisy_world.core.machine import peak_memory_bytes

TELL = """
import sys
sys.path.insert(0, sys.argv[1])
from noisy_world.core.machine import peak_memory_bytes
print(peak_memory_bytes())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="not told on Windows")
def test_the_peak_is_this_process_s_own_and_stays():
    before = peak_memory_bytes()
    block = np.ones(40_000_000)  # 320 MB
    during = peak_memory_bytes()
    del block
    assert during - before > 200e6 or before > 320e6
    assert peak_memory_bytes() > during - 5e6  # the system counts in batches
    told = subprocess.run([sys.executable, "-c", TELL, str(ROOT / "addon")], capture_output=True, text=True, check=True)
    assert 5e6 < int(told.stdout) < 100e6  # though the process that started it has used more
