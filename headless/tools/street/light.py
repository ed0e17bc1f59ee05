# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the street: a sky at dusk, and a light in each lantern."""

import math
from collections.abc import Sequence

import bpy

from .solids import Point
from .surfaces import Shader, Value

LAMP_W = 900.0
WARM = (1.0, 0.62, 0.3)
BULBS_W = 60.0  # of a wire's bulbs together
SKY_STRENGTH = 1.7


def new_sky() -> bpy.types.World:
    """Return a sky after sunset: warm low down where the street ends, blue above, with clouds."""
    world = bpy.data.worlds.new("Dusk")
    tree = world.node_tree
    assert tree is not None
    shader = Shader(tree)
    toward = shader.add("TexCoord", output="Generated")
    x, y, z = shader.parts(toward)
    height = shader.math("MAXIMUM", z, 0.0)
    glow = shader.between(shader.math("SUBTRACT", y, shader.math("MULTIPLY", height, 0.9)), -0.4, 1.0)
    low = shader.mix(glow, (0.16, 0.18, 0.27), (0.95, 0.42, 0.2))
    middle = shader.mix(glow, (0.12, 0.16, 0.3), (0.34, 0.3, 0.38))
    tone = shader.mix(shader.between(height, 0.0, 0.28), low, middle)
    tone = shader.mix(shader.between(height, 0.2, 0.9), tone, (0.07, 0.12, 0.27))
    # Clouds lie on a plane above, so they are flat and dense near the horizon.
    far = shader.math("ADD", height, 0.12)
    on_plane = shader.add("CombineXYZ", {0: shader.math("DIVIDE", x, far), 1: shader.math("DIVIDE", y, far)})
    cloud = shader.between(shader.noise(on_plane, 1.1, 7.0), 0.45, 0.72, 0.0, 0.75)
    lit: Value = shader.mix(glow, (0.1, 0.11, 0.17), (0.62, 0.28, 0.2))
    tone = shader.mix(shader.math("MULTIPLY", cloud, shader.between(height, 0.01, 0.12)), tone, lit)
    shader.end(shader.add("Background", {"Color": tone, "Strength": SKY_STRENGTH}), "OutputWorld")
    return world


def new_lamp(name: str, place: Point, power_w: float, radius_m: float) -> bpy.types.Object:
    """Return a round light."""
    data = bpy.data.lights.new(name, "POINT")
    assert isinstance(data, bpy.types.PointLight)
    data.energy = power_w
    data.color = WARM
    data.shadow_soft_size = radius_m
    lamp = bpy.data.objects.new(name, data)
    lamp.location = place
    lamp.visible_camera = False
    lamp.visible_glossy = False  # the lantern itself is what is reflected
    return lamp


def new_lantern_light(name: str, place: Point) -> bpy.types.Object:
    """Return the light of a lantern, which its iron roof keeps from the sky."""
    data = bpy.data.lights.new(name, "SPOT")
    assert isinstance(data, bpy.types.SpotLight)
    data.energy = LAMP_W
    data.color = WARM
    data.shadow_soft_size = 0.12
    data.spot_size = math.radians(168)
    data.spot_blend = 0.6
    lamp = bpy.data.objects.new(name, data)
    lamp.location = place
    lamp.visible_camera = False
    lamp.visible_glossy = False
    return lamp


def middle_of(places: Sequence[Point]) -> Point:
    """Return the mean of some places."""
    x, y, z = (sum(values) / len(places) for values in zip(*places, strict=True))
    return (x, y, z)
