# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of bodies that deviate smoothly."""

from dataclasses import replace

from ..core.trajectories.deviation import DeviatingCurve, Signal
from ..core.trajectories.trajectory import Trajectory


def deviated(trajectory: Trajectory, translation_m: Signal, turn: Signal) -> Trajectory:
    """Return a path whose body deviates in its own axes: metres and rotation vectors, since the first stamp.

    Poses that are independent of one another deviate alike, and stay so.
    """
    curve = DeviatingCurve(trajectory.continuous, float(trajectory.stamps_s[0]), translation_m, turn)
    c2w = trajectory.c2w @ curve.deviation_at(trajectory.stamps_s)
    return replace(trajectory, c2w=c2w, curve=None if trajectory.independent else curve)
