# SPDX-License-Identifier: GPL-3.0-or-later
"""Code of perturbations, carried out. Settings share clean images, so what it is given is read-only: otherwise one that
writes in place would change the frames of all others.
"""

import contextlib
import re
from collections.abc import Iterator

from ..errors import NoisyWorldError
from .kinds import Perturbation

_REFUSED = re.compile("read-?only")  # numpy's words and OpenCV's


@contextlib.contextmanager
def left_alone(perturbation: Perturbation) -> Iterator[None]:
    """Carry out code of a perturbation. Raises NoisyWorldError, which names it, where it writes into what is given."""
    try:
        yield
    except Exception as error:  # OpenCV's own is none of Python's
        if isinstance(error, OSError) or not _REFUSED.search(str(error)):
            raise
        package = perturbation.distribution
        whose = f"{perturbation.name} of {package}" if package else perturbation.name
        problem = f"{whose}: writes into what it is given, which other settings share ({error})"
        raise NoisyWorldError(problem, remedy="its code has to copy that first") from error
