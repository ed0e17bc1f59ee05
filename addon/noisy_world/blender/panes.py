# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass in a scene of one's own: what is seen through it counts for weather, so that depth is rendered without, too."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

from .typed import get_value, inputs
from .volumes import shader_trees

GLASS = ("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction")
MOST_OPAQUE = 0.5  # a surface that lets through more of the light is a pane; chosen


class Panes:
    """The materials of a scene that are glass, which can be taken away for a while."""

    def __init__(self, blocks: Iterable[bpy.types.ID]) -> None:
        """Find them: what is shown is a glass or refraction shader, or a principled one with more transmission."""
        self._outputs = [
            (tree, node)
            for tree in shader_trees(blocks)
            for node in tree.nodes
            if isinstance(node, bpy.types.ShaderNodeOutputMaterial) and _is_glass(_shader(node))
        ]

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self._outputs)

    @contextmanager
    def gone(self) -> Iterator[None]:
        """Take them away: rays go on straight."""
        given = [(tree, output, _source(output), tree.nodes.new(CLEAR)) for tree, output in self._outputs]
        try:
            for tree, output, _, clear in given:
                tree.links.new(clear.outputs[0], inputs(output)["Surface"])
            yield
        finally:
            for tree, output, source, clear in given:
                tree.nodes.remove(clear)
                tree.links.new(source, inputs(output)["Surface"])


CLEAR = "ShaderNodeBsdfTransparent"


def _source(output: bpy.types.Node) -> bpy.types.NodeSocket:
    links = inputs(output)["Surface"].links
    assert links, "what is not linked is no glass"
    source = links[0].from_socket
    assert source is not None
    return source


def _shader(output: bpy.types.Node) -> bpy.types.Node | None:
    """Return the shader of a material's surface; of a mixture, the first that is glass."""
    waiting, seen = [output], set[bpy.types.Node]()
    found = None
    while waiting:
        node = waiting.pop()
        for socket in node.inputs:
            if socket.type != "SHADER" or (node == output and socket.name != "Surface"):
                continue
            for link in socket.links or ():
                source = link.from_node
                if source is not None and source not in seen:
                    seen.add(source)
                    waiting.append(source)
                    found = source if found is None or _is_glass(source) else found
    return found


def _is_glass(node: bpy.types.Node | None) -> bool:
    if node is None:
        return False
    if node.bl_idname in GLASS:
        return True
    passes = node.inputs.get("Transmission Weight") if node.bl_idname == "ShaderNodeBsdfPrincipled" else None
    return passes is not None and not passes.is_linked and get_value(passes) > MOST_OPAQUE
