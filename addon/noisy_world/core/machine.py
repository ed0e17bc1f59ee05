# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to know of the machine and of this process."""

import os
import sys


def processor_features() -> list[str]:
    """Return the instruction sets that numpy chooses its loops by: float32 exp, log and sin differ between them."""
    from numpy._core._multiarray_umath import __cpu_features__  # noqa: PLC0415 - as numpy.show_runtime does

    return sorted(name for name, there in __cpu_features__.items() if there)


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of this process so far; None where the system does not tell."""
    if sys.platform == "win32":
        return None
    import resource  # noqa: PLC0415 - not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def available_threads() -> int:
    """Return how many threads this process may run at once."""
    return os.process_cpu_count() or 1
