# SPDX-License-Identifier: GPL-3.0-or-later
"""The street's materials: procedural, by world position, so that no picture and no unwrapping is needed."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import bpy

from noisy_world.nodes.datablocks import cycles as cycles_of
from noisy_world.nodes.datablocks import inputs, node_tree, outputs, set_value
from pictures.street_models import GLOW

Colour: TypeAlias = tuple[float, float, float]
Value: TypeAlias = bpy.types.NodeSocket | float | tuple[float, ...]
SHADER_NODES = "ShaderNode"


class Shader:
    """A material's nodes while they are put together."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        """Begin with no nodes."""
        self.tree = tree
        tree.nodes.clear()

    def add(
        self, kind: str, given: Mapping[str | int, Value] | None = None, *, output: str | int = 0, **properties: Any
    ) -> bpy.types.NodeSocket:
        """Add a node of a kind, such as "Math"; return its output. given: its inputs; properties: its settings."""
        node = self.tree.nodes.new(SHADER_NODES + kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for name, value in (given or {}).items():
            self.give(inputs(node)[name], value)
        return outputs(node)[output]

    def give(self, socket: bpy.types.NodeSocket, value: Value) -> None:
        """Link or set an input."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            whole = (*value, 1.0) if isinstance(value, tuple) and socket.type == "RGBA" else value
            set_value(socket, whole)

    def math(self, operation: str, *values: Value) -> bpy.types.NodeSocket:
        """Calculate with numbers."""
        return self.add("Math", dict(enumerate(values)), operation=operation)

    def mix(self, share: Value, first: Value, second: Value) -> bpy.types.NodeSocket:
        """Mix two colours."""
        given: dict[str | int, Value] = {0: share, 6: first, 7: second}
        return self.add("Mix", given, output=2, data_type="RGBA")

    def between(self, value: Value, low: float, high: float, first: float = 0.0, second: float = 1.0) -> Any:
        """Go smoothly from `first` at `low` to `second` at `high`, and no further."""
        given: dict[str | int, Value] = {0: value, 1: low, 2: high, 3: first, 4: second}
        return self.add("MapRange", given, interpolation_type="SMOOTHSTEP")

    def noise(self, where: Value, scale: float, detail: float = 3.0) -> bpy.types.NodeSocket:
        """Return noise of 0 to 1; scale: per metre."""
        return self.add("TexNoise", {"Vector": where, "Scale": scale, "Detail": detail})

    def position(self) -> bpy.types.NodeSocket:
        """Return the place in the world."""
        return self.add("NewGeometry", output="Position")

    def parts(self, vector: Value) -> list[bpy.types.NodeSocket]:
        """Return a vector's three numbers."""
        node = self.tree.nodes.new("ShaderNodeSeparateXYZ")
        self.give(node.inputs[0], vector)
        return list(node.outputs)

    def on_wall(self) -> bpy.types.NodeSocket:
        """Return the place on an upright wall: metres along it and up."""
        turned = self.add("SeparateXYZ", {0: self.add("NewGeometry", output="True Normal")})
        across = self.math("GREATER_THAN", self.math("ABSOLUTE", turned), 0.5)
        x, y, z = self.parts(self.position())
        along = self.add("Mix", {0: across, 2: x, 3: y}, data_type="FLOAT")
        return self.add("CombineXYZ", {0: along, 1: z})

    def surface(self, given: Mapping[str | int, Value]) -> None:
        """End with a Principled BSDF."""
        self.end(self.add("BsdfPrincipled", given))

    def end(self, shader: bpy.types.NodeSocket, kind: str = "OutputMaterial") -> None:
        """End with a shader."""
        self.give(inputs(self.tree.nodes.new(SHADER_NODES + kind))["Surface"], shader)


def new_shader(name: str) -> tuple[bpy.types.Material, Shader]:
    """Return a new material and its nodes."""
    material = bpy.data.materials.new(name)
    return material, Shader(node_tree(material))


def plain(name: str, colour: Colour, roughness: float, metallic: float = 0.0, coat: float = 0.0) -> bpy.types.Material:
    """Return a material of one colour."""
    material, shader = new_shader(name)
    given: dict[str | int, Value] = {"Base Color": colour, "Roughness": roughness, "Metallic": metallic}
    shader.surface(given | {"Coat Weight": coat, "Coat Roughness": 0.04})
    return material


def plaster(name: str, colour: Colour) -> bpy.types.Material:
    """Return painted plaster with stains that run down."""
    material, shader = new_shader(name)
    place = shader.on_wall()
    stretched = shader.add("Mapping", {"Vector": place, "Scale": (1.6, 0.22, 1.0)})
    stains = shader.between(shader.noise(stretched, 1.0, 6.0), 0.35, 0.75)
    patches = shader.noise(shader.position(), 0.7, 5.0)
    dirty = tuple(0.45 * value for value in colour)
    tone = shader.mix(shader.math("MULTIPLY", stains, 0.6), colour, dirty)
    tone = shader.mix(shader.between(patches, 0.4, 0.8, 0.0, 0.35), tone, tuple(0.8 * v + 0.04 for v in colour))
    bump = shader.add("Bump", {"Strength": 0.25, "Height": shader.noise(shader.position(), 40.0, 4.0)})
    shader.surface({"Base Color": tone, "Roughness": 0.85, "Normal": bump})
    return material


def brickwork(name: str, first: Colour, second: Colour) -> bpy.types.Material:
    """Return a wall of bricks, 22 x 7 cm."""
    material, shader = new_shader(name)
    place = shader.on_wall()
    node: dict[str | int, Value] = {"Vector": place, "Color1": first, "Color2": second, "Mortar": (0.2, 0.18, 0.16)}
    node |= {"Scale": 1.0, "Mortar Size": 0.008, "Brick Width": 0.23, "Row Height": 0.075, "Bias": -0.2}
    bricks = shader.add("TexBrick", node)
    grime = shader.between(shader.noise(shader.position(), 0.8, 6.0), 0.35, 0.8, 0.0, 0.55)
    tone = shader.mix(grime, bricks, tuple(0.35 * value for value in first))
    joint = shader.add("TexBrick", node, output=1)
    bump = shader.add("Bump", {"Strength": 0.5, "Distance": 0.01, "Height": shader.math("SUBTRACT", 1.0, joint)})
    shader.surface({"Base Color": tone, "Roughness": 0.8, "Normal": bump})
    return material


def wet(shader: Shader, tone: Value, height: Value, puddles: tuple[float, float]) -> None:
    """End with a surface that is wet: dark and shining where water stands, rough between. puddles: noise from, to."""
    water = shader.between(shader.noise(shader.position(), 0.45, 4.0), *puddles)
    film = shader.between(shader.noise(shader.position(), 2.5, 5.0), 0.35, 0.75, 0.42, 0.2)
    roughness = shader.add("Mix", {0: water, 2: film, 3: 0.03}, data_type="FLOAT")
    dark = shader.mix(shader.math("MULTIPLY", water, 0.7), tone, (0.012, 0.012, 0.013))
    strength = shader.add("Mix", {0: water, 2: 0.45, 3: 0.0}, data_type="FLOAT")
    bump = shader.add("Bump", {"Strength": strength, "Distance": 0.01, "Height": height})
    shader.surface({"Base Color": dark, "Roughness": roughness, "Normal": bump, "IOR": 1.33})


def asphalt(name: str) -> bpy.types.Material:
    """Return a wet road."""
    material, shader = new_shader(name)
    place = shader.position()
    grains = shader.noise(place, 90.0, 2.0)
    patches = shader.between(shader.noise(place, 0.5, 5.0), 0.35, 0.7)
    tone = shader.mix(patches, (0.045, 0.045, 0.048), (0.09, 0.086, 0.082))
    tone = shader.mix(shader.between(grains, 0.55, 0.75, 0.0, 0.5), tone, (0.12, 0.12, 0.12))
    cracks = shader.add("TexVoronoi", {"Vector": place, "Scale": 0.6}, feature="DISTANCE_TO_EDGE")
    tone = shader.mix(shader.between(cracks, 0.004, 0.012, 0.6, 0.0), tone, (0.01, 0.01, 0.01))
    wet(shader, tone, grains, (0.56, 0.64))
    return material


def paving(name: str) -> bpy.types.Material:
    """Return wet slabs of 60 x 40 cm."""
    material, shader = new_shader(name)
    node: dict[str | int, Value] = {"Vector": shader.position(), "Scale": 1.0, "Mortar Size": 0.012}
    node |= {"Brick Width": 0.6, "Row Height": 0.4, "Color1": (0.15, 0.145, 0.14), "Color2": (0.1, 0.098, 0.1)}
    slabs = shader.add("TexBrick", node | {"Mortar": (0.025, 0.025, 0.025)})
    joint = shader.add("TexBrick", node, output=1)
    tone = shader.mix(shader.between(shader.noise(shader.position(), 6.0, 6.0), 0.4, 0.7, 0.0, 0.4), slabs, (0.06,) * 3)
    height = shader.math("SUBTRACT", shader.math("MULTIPLY", shader.noise(shader.position(), 60.0), 0.3), joint)
    wet(shader, tone, height, (0.55, 0.66))
    return material


def panes(name: str) -> bpy.types.Material:
    """Return window panes: dark and reflecting, or lit from within by the face's glow, through curtains."""
    material, shader = new_shader(name)
    glow = shader.add("Attribute", output="Fac", attribute_name=GLOW, attribute_type="GEOMETRY")
    place = shader.on_wall()
    folds = shader.add("Mapping", {"Vector": place, "Scale": (14.0, 0.6, 1.0)})
    curtain = shader.between(shader.noise(folds, 1.0, 2.0), 0.3, 0.7, 0.45, 1.0)
    inside = shader.between(shader.noise(place, 1.1, 3.0), 0.35, 0.65, 0.35, 1.0)
    strength = shader.math("MULTIPLY", glow, shader.math("MULTIPLY", curtain, inside))
    warm = shader.mix(shader.noise(place, 0.31, 0.0), (1.0, 0.42, 0.12), (1.0, 0.72, 0.42))
    given: dict[str | int, Value] = {"Base Color": (0.012, 0.016, 0.02), "Roughness": 0.03, "Specular IOR Level": 0.8}
    shader.surface(given | {"Emission Color": warm, "Emission Strength": strength})
    return material


def glowing(name: str, colour: Colour) -> bpy.types.Material:
    """Return what shines by itself, as much as the face's glow says; lights of their own light the street."""
    material, shader = new_shader(name)
    strength = shader.add("Attribute", output="Fac", attribute_name=GLOW, attribute_type="GEOMETRY")
    shader.end(shader.add("Emission", {"Color": colour, "Strength": strength}))
    return material


def striped(name: str, first: Colour, second: Colour) -> bpy.types.Material:
    """Return cloth with stripes along the street."""
    material, shader = new_shader(name)
    along = shader.add("SeparateXYZ", {0: shader.position()}, output=1)
    stripe = shader.math("GREATER_THAN", shader.math("FRACT", shader.math("MULTIPLY", along, 2.2)), 0.5)
    shader.surface({"Base Color": shader.mix(stripe, first, second), "Roughness": 0.9})
    return material


def grained(name: str, dark: Colour, light: Colour, scale: tuple[float, float, float]) -> bpy.types.Material:
    """Return wood, bark or tiles: noise stretched by `scale`."""
    material, shader = new_shader(name)
    grain = shader.noise(shader.add("Mapping", {"Vector": shader.position(), "Scale": scale}), 1.0, 5.0)
    tone = shader.mix(shader.between(grain, 0.3, 0.7), dark, light)
    bump = shader.add("Bump", {"Strength": 0.5, "Distance": 0.01, "Height": grain})
    shader.surface({"Base Color": tone, "Roughness": 0.6, "Normal": bump})
    return material


def street_materials() -> dict[str, bpy.types.Material]:
    """Return all materials of the street by name; colours are scene-linear and chosen by eye."""
    made = [
        asphalt("asphalt"),
        paving("paving"),
        panes("panes"),
        brickwork("red brick", (0.17, 0.055, 0.035), (0.1, 0.035, 0.025)),
        brickwork("brown brick", (0.13, 0.085, 0.055), (0.08, 0.05, 0.035)),
        plaster("ochre", (0.42, 0.28, 0.13)),
        plaster("cream", (0.5, 0.45, 0.36)),
        plaster("blue grey", (0.2, 0.25, 0.3)),
        plaster("rose", (0.4, 0.22, 0.18)),
        plaster("stone", (0.28, 0.26, 0.23)),
        plain("white paint", (0.6, 0.58, 0.54), 0.5),
        plain("road paint", (0.45, 0.45, 0.43), 0.35),
        plain("iron", (0.02, 0.022, 0.025), 0.35, 0.8),
        plain("dark green", (0.015, 0.05, 0.035), 0.35, 0.0, 0.5),
        plain("rubber", (0.012, 0.012, 0.012), 0.7),
        plain("chrome", (0.7, 0.7, 0.7), 0.12, 1.0),
        plain("car glass", (0.01, 0.012, 0.014), 0.02, 0.0, 1.0),
        plain("car red", (0.25, 0.012, 0.01), 0.3, 0.2, 1.0),
        plain("car blue", (0.015, 0.04, 0.12), 0.3, 0.3, 1.0),
        plain("car silver", (0.32, 0.33, 0.34), 0.3, 0.6, 1.0),
        plain("porcelain", (0.75, 0.74, 0.7), 0.15, 0.0, 0.5),
        plain("goods", (0.35, 0.12, 0.05), 0.6),
        plain("books", (0.05, 0.15, 0.3), 0.6),
        plain("chalkboard", (0.01, 0.011, 0.012), 0.8),
        striped("awning red", (0.3, 0.02, 0.02), (0.6, 0.56, 0.5)),
        striped("awning green", (0.02, 0.12, 0.06), (0.6, 0.56, 0.5)),
        grained("wood", (0.07, 0.032, 0.014), (0.2, 0.1, 0.045), (3.0, 40.0, 40.0)),
        grained("bark", (0.018, 0.014, 0.011), (0.06, 0.048, 0.036), (18.0, 18.0, 3.0)),
        grained("leaves", (0.006, 0.014, 0.006), (0.025, 0.05, 0.02), (30.0, 30.0, 30.0)),
        grained("roof", (0.035, 0.03, 0.03), (0.1, 0.06, 0.05), (8.0, 8.0, 14.0)),
        glowing("lantern", (1.0, 0.62, 0.28)),
        glowing("bulb", (1.0, 0.55, 0.2)),
        glowing("red light", (1.0, 0.02, 0.01)),
        glowing("shop light", (1.0, 0.82, 0.6)),
        glowing("neon", (0.1, 0.75, 1.0)),
    ]
    for material in made:
        if material.name in ("bulb", "lantern", "red light", "neon"):
            # Too small to light the street by chance: light objects do it.
            cycles_of(material).emission_sampling = "NONE"
    return {material.name: material for material in made}
