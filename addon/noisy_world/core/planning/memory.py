# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory that a plan's frames take, by the pixel, and the refusal of a plan that is beyond what there is."""

from ..errors import MORE_MEMORY, OutOfMemoryError
from ..machine import free_memory_bytes, held_memory_bytes
from .estimate import size_text
from .plan import Plan, Render

# Measured as the peak of a run at 1200 x 680 and at 3600 x 2040 pixels, and rounded down: what frames take at least.
BYTES_READ = 16  # a pixel of a recording, read and written
BYTES_RENDERED = 60  # by Embree: colour and depth, rendered and written
BYTES_RENDERED_IN_BLENDER = 115  # by Cycles and Workbench
BYTES_PERTURBED = 25  # colour, in numpy and OpenCV, in addition
BYTES_COMPOSITED = 55  # colour, in Blender's compositor, in addition
BYTES_OF_PYTHON = 90_000_000
BYTES_OF_BLENDER = 450_000_000


def memory_bytes(plan: Plan) -> int:
    """Estimate the bytes of memory that a process takes at least which makes the plan's frames, but for its scenes."""
    frame = max((_frame_bytes(plan, render) for render in plan.renders), default=0)
    return frame + (BYTES_OF_BLENDER if plan.needs_blender else BYTES_OF_PYTHON)


def check_memory(plan: Plan, processes: int = 1) -> None:
    """Raise OutOfMemoryError where processes that make frames of a plan need more memory than this one may take.

    What this process holds already, it need not take.
    """
    needed, free = processes * memory_bytes(plan), free_memory_bytes()
    if free is None or needed <= free + held_memory_bytes():
        return
    largest = max(plan.renders, key=lambda render: _frame_bytes(plan, render))
    size = f"{largest.camera.width_px} x {largest.camera.height_px} pixels"
    several = f" in each of {processes} processes" if processes > 1 else ""
    raise OutOfMemoryError(
        f"frames of {size} need at least {size_text(needed // processes)} of memory{several}, and "
        f"{size_text(free)} are free here",
        file=plan.preset.path,
        where="camera",
        remedy="take fewer jobs" if processes > 1 else MORE_MEMORY,
    )


def _frame_bytes(plan: Plan, render: Render) -> int:
    capabilities = render.scene.source.capabilities
    each = BYTES_READ
    if capabilities.rendered:
        engine = plan.preset.spec.render.engine if capabilities.own is None else capabilities.own.engine
        each = BYTES_RENDERED if engine == "embree" else BYTES_RENDERED_IN_BLENDER
    coloured = [sequence.setting for sequence in render.sequences if sequence.setting.rgb]
    if "rgb" in plan.format.modalities and coloured:
        each += BYTES_COMPOSITED if any(setting.composited for setting in coloured) else BYTES_PERTURBED
    pixels = max(camera.width_px * camera.height_px for camera in (render.camera, render.depth_camera))
    return each * pixels
