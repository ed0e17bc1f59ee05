# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth as a setting writes it, and desynchronisation, as a picture in the image editor."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender.still import render_stills
from ..core.errors import NoisyWorldError
from ..core.images import rgb_bytes
from ..core.mixture import Setting, perturb_depth
from ..core.overview import colour_depth
from ..core.plan import Sequence, lay_out
from .document import identifiers_of, steps_of
from .paths import clean_poses
from .properties import perturbation_of

PICTURE = "Noisy World depth"
ABOUT = "noisy_world_shows"


def sequence_of(scene: bpy.types.Scene) -> tuple[Sequence, int]:
    """Return the sequence that a scene's settings describe, and which of its frames the scene stands at.

    Raises NoisyWorldError where the settings are wrong.
    """
    settings = scene.noisy_world
    poses = clean_poses(scene)
    count = scene.frame_end + 1 if poses is None else len(poses)
    setting = Setting(settings.setting_name, steps_of(settings))
    sequence = lay_out(setting, settings.scene_name, count, identifiers_of(settings))
    last = (count - 1) // sequence.every
    return sequence, max(0, min(scene.frame_current // sequence.every, last))


def draw_picture(scene: bpy.types.Scene) -> tuple[NDArray[np.uint8], str]:
    """Render the scene's frame and return its perturbed depth in colours (H, W, 3), and what it shows.

    With desynchronisation (H, 2 W, 3): the frame's colour, and the depth that is paired with it beside. Raises
    NoisyWorldError where the settings are wrong, or the scratch file cannot be written.
    """
    sequence, index = sequence_of(scene)
    if sequence.depth_of is not None and sequence.depth_of[index] < 0:
        raise NoisyWorldError(f"frame {index} is left out: there is no depth to pair with it")
    source = sequence.depth_source(index)
    taken = source // sequence.every
    if sequence.depth_of is None:
        (still,) = render_stills(scene, [source], rgb=False)
        colour = None
    else:
        first, still = render_stills(scene, [sequence.rgb_source(index), source], rgb=True)
        colour = rgb_bytes(first.rgb)
    depth_m, notes = perturb_depth(sequence.setting.depth, still.depth_m, taken, sequence.identifiers)
    depth_m = still.depth_m if depth_m is None else depth_m
    seen_m = depth_m[depth_m > 0]
    near_m, far_m = (float(seen_m.min()), float(seen_m.max())) if seen_m.size else (0.0, 1.0)
    picture = colour_depth(depth_m, near_m, far_m)
    about = f"depth from {near_m:.2f} m (red) to {far_m:.2f} m (blue), void grey"
    if notes:
        about += f"; {', '.join(note['name'] for note in notes)}"
    if colour is None:
        return picture, f"Frame {index}: {about}"
    return np.concatenate([colour, picture], axis=1), f"Colour of frame {index}, depth of frame {taken}: {about}"


def show_picture(picture: NDArray[np.uint8], about: str) -> bpy.types.Image:
    """Put a picture (H, W, 3) into the image of the preview."""
    height, width = picture.shape[:2]
    image = next((item for item in bpy.data.images if item.name == PICTURE and item.library is None), None)
    if image is None:
        image = bpy.data.images.new(PICTURE, width, height, alpha=False)
    elif tuple(image.size) != (width, height):
        image.scale(width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image[ABOUT] = about
    return image


def open_picture(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in an image editor: one that is open, or a window of its own."""
    manager = context.window_manager
    areas = [area for window in manager.windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]
    shown = next((area for area in areas if area.spaces.active.image == image), areas[0] if areas else None)
    if shown is None and not bpy.app.background:
        before = {window.as_pointer() for window in manager.windows}
        bpy.ops.wm.window_new()
        window = next(window for window in manager.windows if window.as_pointer() not in before)
        shown = window.screen.areas[0]
        shown.type = "IMAGE_EDITOR"
    if shown is not None:
        shown.spaces.active.image = image
        shown.tag_redraw()


class PreviewDepth(bpy.types.Operator):
    """Render this frame's depth, perturb it as the generator does, and show it in colours in an image editor"""

    bl_idname = "noisy_world.preview_depth"
    bl_label = "Preview Depth"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Where there is a camera to see through."""
        if context.scene is None or context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Render and show."""
        try:
            picture, about = draw_picture(context.scene)
        except NoisyWorldError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        open_picture(context, show_picture(picture, about))
        self.report({"INFO"}, about)
        return {"FINISHED"}


def has_depth_steps(settings: Any) -> bool:
    """Tell whether something is done to depth, or to what it is paired with."""
    return any(step.enabled and perturbation_of(step).category in ("depth", "sync") for step in settings.steps)


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button, where there is something to see beyond the live preview."""
    if has_depth_steps(context.scene.noisy_world):
        layout.operator(PreviewDepth.bl_idname, icon="IMAGE_ZDEPTH")


def register() -> None:
    """Register the operator."""
    bpy.utils.register_class(PreviewDepth)


def unregister() -> None:
    """Take it away; the picture stays the file's."""
    bpy.utils.unregister_class(PreviewDepth)
