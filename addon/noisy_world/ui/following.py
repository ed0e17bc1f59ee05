# SPDX-License-Identifier: GPL-3.0-or-later
"""An operator that starts a run in the background and follows it while the windows stay usable."""

import contextlib
from typing import TYPE_CHECKING

import bpy

from ..blender.typed import override
from ..core.errors import NoisyWorldError
from .runs import SceneRun
from .wording import spoken

if TYPE_CHECKING:
    _Mixin = bpy.types.Operator  # what Following is mixed into
else:
    _Mixin = object

LOOK_EVERY_S = 0.2  # between polls of the run; chosen: smooth for a progress bar, and cheap


class Following(_Mixin):
    """Start a run and follow it to its end: what an operator gives says which run, and what becomes of its result.

    No abstract base class: Blender's operators have a metaclass of their own.
    """

    _timer: bpy.types.Timer | None = None
    _run: SceneRun | None = None

    def begin(self, scene: bpy.types.Scene) -> SceneRun:
        """Start the run. Raises NoisyWorldError where that cannot be."""
        raise NotImplementedError

    def take(self, run: SceneRun) -> str:
        """Take the result of a run that has finished; return a sentence on it. Raises NoisyWorldError."""
        raise NotImplementedError

    def started(self, context: bpy.types.Context) -> bool:
        """Start the run; tell whether that went well."""
        try:
            self._run = self.begin(context.scene)
        except NoisyWorldError as error:
            self.report({"ERROR"}, spoken(error.message))
            return False
        return True

    def waited(self, context: bpy.types.Context) -> set[str]:
        """Wait for the end of the run, for scripts."""
        assert self._run is not None
        self._run.background.wait()
        return self._conclude(context)

    def followed(self, context: bpy.types.Context) -> set[str]:
        """Let the window stay usable while the run goes on."""
        self._timer = context.window_manager.event_timer_add(LOOK_EVERY_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the run."""
        assert self._run is not None
        playing = context.screen is not None and context.screen.is_animation_playing
        if event.type == "ESC" and event.value == "PRESS" and not playing:
            self._run.background.cancel()
            redraw(context)
            return {"RUNNING_MODAL"}
        if event.type == "TIMER" and self._run.background.poll():
            redraw(context)
        if not self._run.background.active:
            return self._conclude(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """End the run when the window that it was started from closes."""
        if self._run is not None:
            self._run.background.close()
            self._leave(context)

    def _conclude(self, context: bpy.types.Context) -> set[str]:
        assert self._run is not None
        state = self._run.background
        try:
            if state.phase == "failed":
                self.report({"ERROR"}, spoken(state.error, self._run.preset))
                return {"CANCELLED"}
            if state.phase == "stopped":
                self.report({"WARNING"}, self._run.stopped)
                return {"CANCELLED"}
            self.report({"INFO"}, self.take(self._run))
        except NoisyWorldError as error:
            self.report({"ERROR"}, spoken(error.message))
            return {"CANCELLED"}
        finally:
            self._leave(context)
        return {"FINISHED"}

    def _leave(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._run is not None:
            self._run.tidy()
        redraw(context)


def redraw(context: bpy.types.Context) -> None:
    """Redraw panels and status bar."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
        with contextlib.suppress(TypeError, RuntimeError), override(window=window):
            window.workspace.status_text_set_internal(None)  # what has the status bar drawn
