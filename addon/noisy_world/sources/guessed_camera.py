# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera of images that nothing says one of: a guess, or the one that the preset gives."""

from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath

# Of the larger side: what COLMAP begins with (ImageReaderOptions::default_focal_length_factor).
FOCAL_LENGTH_FACTOR = 1.2
GUESSED = (
    "nothing says its camera: a guess is written, with a focal length of 1.2 times the larger side; camera says another"
)


def given_or_guessed(asked: Intrinsics | None, size_px: tuple[int, int], place: ConfigPath, what: str) -> Intrinsics:
    """Return the intrinsics asked for or, where none are, a guess.

    place: the key of the source. what: the word for its images. Raises InputError where another size is asked for.
    """
    wide, high = size_px
    if asked is None:
        focal_px = FOCAL_LENGTH_FACTOR * max(wide, high)
        return Intrinsics(wide, high, focal_px, focal_px, (wide - 1) / 2, (high - 1) / 2)
    if (asked.width_px, asked.height_px) != size_px:
        problem = f"its {what} are {wide} x {high}, but the preset's camera has {asked.width_px} x {asked.height_px}"
        raise place.error(problem, "set camera to that, or leave it out")
    return asked
