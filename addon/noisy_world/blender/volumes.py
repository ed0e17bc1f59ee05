# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoke, fog and the like in a scene of one's own: rays end in them by chance, so depth is rendered without."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

from .typed import inputs


class Volumes:
    """The volumes of a scene's materials, which can be taken away for a while."""

    def __init__(self, blocks: Iterable[bpy.types.ID], *, needed: bool) -> None:
        """Find them. needed: whether they have to come back."""
        self._outputs = [
            (tree, node)
            for tree in shader_trees(blocks)
            for node in tree.nodes
            if isinstance(node, bpy.types.ShaderNodeOutputMaterial) and inputs(node)["Volume"].is_linked
        ]
        self._needed = needed
        self._gone = False

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self._outputs)

    @contextmanager
    def gone(self) -> Iterator[None]:
        """Take them away; what is nothing but a volume is as good as not there."""
        if self._gone or not self._outputs:
            yield
            return
        given = [_without(tree, node) for tree, node in self._outputs]
        try:
            yield
        finally:
            self._gone = not self._needed
            if self._needed:
                for (tree, node), (source, clear) in zip(self._outputs, given, strict=True):
                    if clear is not None:
                        tree.nodes.remove(clear)
                    tree.links.new(source, inputs(node)["Volume"])


def _without(tree: bpy.types.NodeTree, output: bpy.types.Node) -> tuple[bpy.types.NodeSocket, bpy.types.Node | None]:
    """Unlink a material's volume; return what it came from, and what stands for a surface where there is none."""
    links = inputs(output)["Volume"].links
    assert links
    link = links[0]
    source = link.from_socket
    assert source is not None
    tree.links.remove(link)
    if inputs(output)["Surface"].is_linked:
        return source, None
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(clear.outputs[0], inputs(output)["Surface"])
    return source, clear


def shader_trees(blocks: Iterable[bpy.types.ID]) -> list[bpy.types.NodeTree]:
    """Return the nodes of the materials, and the groups of shader nodes, among some data-blocks."""
    found = [block.node_tree if isinstance(block, bpy.types.Material) else block for block in blocks]
    return [tree for tree in found if isinstance(tree, bpy.types.ShaderNodeTree)]
