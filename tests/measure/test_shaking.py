# SPDX-License-Identifier: GPL-3.0-or-later
"""How a camera shakes comes back by octaves: sines of known amplitude have the rms of their amplitude over root 2."""

from types import SimpleNamespace

import numpy as np
import pytest

from noisy_world.core.geometry import rotation_from_rotvec
from noisy_world.measure.motion import Steps
from noisy_world.measure.shaking import shaking

RATE_HZ = 30.0
COUNT = 300
TURN_DEG, SHIFT_M = 0.6, 0.004  # amplitudes, at 3 and at 6 Hz
STAMPS_S = np.arange(COUNT) / RATE_HZ


def turns_deg(times_s):
    """(N, 3): about one axis at 3 Hz, and steadily about another."""
    return np.stack([TURN_DEG * np.sin(2 * np.pi * 3.1 * times_s), 5 * times_s, 0 * times_s], axis=1)


def footage(posed=COUNT):
    c2w = np.tile(np.eye(4), (COUNT, 1, 1))
    c2w[:, :3, :3] = rotation_from_rotvec(np.radians(turns_deg(STAMPS_S)))
    c2w[:, 0, 3] = SHIFT_M * np.sin(2 * np.pi * 6 * STAMPS_S)
    stamps = SimpleNamespace(pose=SimpleNamespace(seconds=STAMPS_S), rgb=SimpleNamespace(seconds=STAMPS_S))
    path = SimpleNamespace(known=np.arange(COUNT) < posed, c2w=c2w)
    return SimpleNamespace(path=path, stamps=stamps, rate_hz=RATE_HZ)


def steps(count=COUNT - 1):
    move = np.full((count, 6), np.nan)
    move[:, :3] = np.radians(np.diff(turns_deg(STAMPS_S), axis=0))[:count]
    frames = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    no = np.zeros(count, np.bool_)
    return Steps(
        frames, np.zeros(count, int), move, np.zeros((count, 6, 6)), np.zeros((count, 6)), no, no, np.ones(count), {}
    )


@pytest.mark.parametrize("by_poses", [True, False])
def test_sines_come_back_in_their_octaves(by_poses):
    found = {figure.name: figure for figure in shaking(footage(COUNT if by_poses else 0), steps())}
    known = {"shake_turn_deg_2_to_4_hz": TURN_DEG / 2**0.5}
    if by_poses:
        known["shake_shift_m_4_to_8_hz"] = SHIFT_M / 2**0.5
    for name, rms in known.items():
        assert found[name].value == pytest.approx(rms, rel=0.03)
        assert found[name].low < rms < found[name].high
        assert found[name].of == ("poses" if by_poses else "steps")
    assert found["shake_turn_deg_4_to_8_hz"].value < 0.05 * TURN_DEG
    assert "shake_turn_deg_8_to_16_hz" not in found  # half of the rate is 15 Hz
    assert by_poses or "too few poses" in found["shake_shift_m"].untold


@pytest.mark.parametrize("given", [None, steps(20)], ids=["none", "few"])
def test_too_few_poses_and_frames_tell_nothing(given):
    turn, shift = shaking(footage(0), given)
    assert "too few poses" in turn.untold
    assert "too few poses" in shift.untold
