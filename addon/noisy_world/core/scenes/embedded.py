# SPDX-License-Identifier: GPL-3.0-or-later
"""The names of the embedded rooms: `embedded:room`, and `embedded:room?seed=0` to 7, the first of which is the same."""

import fnmatch
import re

EMBEDDED_ROOM = "embedded:room"
ROOMS = 8
MEANT = f"did you mean {EMBEDDED_ROOM!r}, or {EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}?"  # the remedy for another name


def is_embedded(mesh: str | None) -> bool:
    """Return whether a preset's mesh is one that comes with Noisy World, or is meant to be."""
    return mesh is not None and mesh.startswith("embedded:")


def room_mesh(seed: int) -> str:
    """Return what a preset says for the room of a seed; room 0 is the plain name."""
    return f"{EMBEDDED_ROOM}?seed={seed}" if seed else EMBEDDED_ROOM


def room_name(mesh: str, seed: int) -> str:
    """Return the name of a scene that has none of its own: room for the plain name, else room and the seed."""
    return "room" if mesh == EMBEDDED_ROOM else f"room{seed}"


def room_seeds(mesh: str) -> list[int]:
    """Return the seeds that a preset's mesh stands for: one, or as many as its wildcards (* and [1-3]) match.

    Raises ValueError where it stands for none.
    """
    if mesh == EMBEDDED_ROOM:
        return [0]
    found = re.fullmatch(re.escape(EMBEDDED_ROOM) + r"\?seed=(.+)", mesh)
    if found is None:
        raise ValueError(f"there is no {mesh!r}")
    seeds = [k for k in range(ROOMS) if fnmatch.fnmatchcase(str(k), found[1])]
    if not seeds:
        raise ValueError(f"there is no {mesh!r}")
    return seeds
