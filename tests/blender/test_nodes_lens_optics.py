# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of vignetting, chromatic aberration and bloom beside their references."""

from cases import cases
from group_tools import by_reference, levels_apart, many_by_nodes, picture, step_of

GIVEN = [
    ("vignetting", {"severity": 1}),
    ("vignetting", {"severity": 5}),
    ("vignetting", {"corner_loss": 0.3, "radius_power": 1.0, "cosine_power": 4.0, "view_deg": 70}),
    ("vignetting", {"corner_loss": 0.9, "axis_across": 0.3, "axis_down": 0.8}),
    ("bloom", {"severity": 1}),
    ("bloom", {"severity": 5}),
    ("bloom", {"amount": 1.0, "reach_px": 9.0}),
    ("chromatic_aberration", {"severity": 1}),
    ("chromatic_aberration", {"severity": 5}),
    ("chromatic_aberration", {"red_px": -2.5, "blue_px": 1.25, "axis_across": 0.3, "axis_down": 0.8}),
]


@cases("size", [(67, 93), (31, 45), (1, 7)])
def test_nodes_are_their_references(size):
    image = picture(*size)
    chains = {f"{place}": [step_of(name, **values)] for place, (name, values) in enumerate(GIVEN)}
    (made,) = many_by_nodes(chains, [image])
    for (name, values), one in zip(GIVEN, made.values(), strict=True):
        other = by_reference(name, image, **values)[0]
        assert levels_apart(one, other)[0] < 1, (name, values)
