# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers of Blender's events, which a module of the panel adds and removes together."""

from collections.abc import Callable, Iterator
from typing import Any

import bpy


class Handlers:
    """Functions by the names of Blender's lists of handlers, such as load_post. Those that stay with another file are
    marked `persistent`."""

    def __init__(self, **functions: Callable[..., None]) -> None:
        self._functions = functions

    def add(self) -> None:
        """Have them called."""
        for handlers, function in self._places():
            handlers.append(function)

    def remove(self) -> None:
        """Have them called no more."""
        for handlers, function in self._places():
            handlers.remove(function)

    def _places(self) -> Iterator[tuple[list[Any], Callable[..., None]]]:
        for name, function in self._functions.items():
            yield getattr(bpy.app.handlers, name), function
