# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m noisy_world`: the command `noisy-world`."""

import sys

from .cli.command import main

if __name__ == "__main__":
    sys.exit(main())
