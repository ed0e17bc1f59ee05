# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of what is on the lens beside the executions on arrays: the same drops, the same dirt."""

import cv2
import numpy as np
from cases import cases
from group_tools import by_groups, by_nodes, by_reference, levels_apart, picture

NAMES = ("lens_drops", "lens_dirt")
SIZE = (90, 150)
DROPS = (
    {"severity": 1, "size_px": 8.0},
    {"severity": 5, "size_px": 12.0, "caustic": 3.0},
    {"severity": 3, "size_px": 30.0, "temporal": "fresh", "runs": 1.0, "contact_deg": 85.0},
    {"severity": 5, "size_px": 14.0, "focus_px": 0.0, "temporal": "fixed", "spread": 1.5, "view_deg": 40.0},
)
DIRT = (
    {"severity": 5, "beside": 1.5, "lens": 12},
    {"severity": 3, "size": 0.3, "streaks": 1.0, "smudges": 1.0, "wiped_deg": -130.0},
    {"severity": 1, "size": 4.0, "streaks": 0.0, "reach_px": 10.0, "glare": 4.0, "temporal": "fresh"},
)


@cases("values", DROPS)
def test_drops_are_the_reference_s_drop_for_drop(values):
    image = picture(*SIZE)
    made = [make("lens_drops", image, (0, 977), **values) for make in (by_nodes, by_reference)]
    for found, wanted in zip(*made, strict=True):
        most, mean = levels_apart(found, wanted)
        assert mean < 0.02
        # Where a pixel lies on a drop's rim to within rounding, a sharp glass shows the drop or not.
        assert most < 0.5 or (values.get("focus_px") == 0 and np.mean(np.abs(found - wanted) > 2e-3) < 1e-3)
        assert np.abs(found - image).mean() > 1e-3


@cases("values", DIRT)
def test_dirt_is_the_reference_s(values):
    image = picture(*SIZE)
    made = [make("lens_dirt", image, (0, 3), **values) for make in (by_nodes, by_reference)]
    for found, wanted in zip(*made, strict=True):
        assert levels_apart(found, wanted)[0] < 0.5
        assert np.abs(found - image).mean() > 2e-3


def test_without_drops_the_image_stays():
    image = picture(*SIZE)
    (found,) = by_nodes("lens_drops", image, severity=3, coverage=0.0, runs=0.0)
    assert levels_apart(found, image)[0] < 0.01


@cases("name", NAMES)
def test_a_preview_looks_like_the_frame(name):
    image = cv2.GaussianBlur(picture(180, 300), (0, 0), 2)
    small = np.asarray(cv2.resize(image, (150, 90), interpolation=cv2.INTER_AREA), np.float32)
    (frame,) = by_nodes(name, image, severity=5)
    (preview,) = by_nodes(name, small, severity=5, reference_width=300)
    wanted = cv2.resize(frame, (150, 90), interpolation=cv2.INTER_AREA)
    assert np.abs(preview - wanted).mean() < 0.15 * np.abs(wanted - small).mean()


def test_what_is_brighter_than_white_comes_through(tmp_path):
    """Groups in an artist's compositor, in linear light, before lamps of 4, 20 and 100."""
    light = np.full((48, 72, 3), 0.2, np.float32)
    lamps = {4: slice(4, 12), 20: slice(20, 28), 100: slice(36, 44)}
    for value, rows in lamps.items():
        light[rows, 8:16] = value
    made = by_groups({name: (name, {"Reference Width": 600}) for name in NAMES}, light, tmp_path)
    for name, found in made.items():
        assert np.isfinite(found).all(), name
        for value, rows in lamps.items():
            assert found[rows, 8:16].max() > 0.8 * value, name
        assert found.max() < 110, name
        # Lamps are seen in drops, or lit dirt, where there are none.
        assert found[:, 30:].max() > 0.25, name
