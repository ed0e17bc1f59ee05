# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preset holds, and what a run of it would do, as text."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.progress import counted, duration_text

if TYPE_CHECKING:
    from ..dataset.plan import Plan, Render


HELD = ("scenes", "settings", "sequences")  # what a preset holds
MOST_RENDERS = 20  # that a dry run lists one by one
MOST_SETTINGS = 12  # of a render that it names


def list_plan(plan: "Plan", what: str) -> int:
    """List what a preset holds."""
    if what == "scenes":
        for render in plan.renders:
            print(f"{render.name}  {counted(len(render.frames), 'frame')}  {render.scene.source.location}")
    elif what == "settings":
        for setting in plan.settings:
            print(setting.name)
    else:
        for sequence in plan.sequences:
            print(sequence.folder)
    return 0


def print_plan(plan: "Plan", out: Path | str) -> None:
    """Print what a run would do."""
    from ..core.machine import free_memory_bytes
    from ..dataset.estimate import estimate, memory_bytes, quicker, size_text, usual_memory_bytes
    from ..dataset.machine_pace import measured_pace
    from ..dataset.plan import plan_notes
    from ..measure.looking import remarks_on

    pace = measured_pace(plan)
    guess = estimate(plan, pace)
    print(f"preset     {plan.preset.path} (SHA-256 {plan.preset.sha256[:12]})")
    print(f"dataset    {out} ({plan.format.layout.name} layout, {plan.format.image} and 16-bit png)")
    cameras = plan.cameras if plan.camera is None else {"": plan.camera}
    for scene, camera in cameras.items():
        whose = f"{scene}: " if scene else ""
        print(f"camera     {whose}{camera.width_px} x {camera.height_px}, fx {camera.fx_px:g}, fy {camera.fy_px:g}")
    if plan.format.note:
        print(f"note       {plan.format.note}")
    for text in plan_notes(plan):
        print(f"note       {text}")
    for scene in plan.scenes:
        for text in remarks_on(scene.source, plan.cameras[scene.name], 0):
            print(f"note       {scene.name}: {text}")
    scenes, settings = counted(len(plan.scenes), "scene"), counted(len(plan.settings), "setting")
    print(f"sequences  {len(plan.sequences)} ({scenes}, {settings})")
    for line in render_lines(plan):
        print(f"  {line}")
    print(f"renders    {len(plan.renders)}, {counted(plan.frame_count, 'frame')} in all")
    between = f"{size_text(guess.least_bytes)} to {size_text(guess.most_bytes)}, by what the images show"
    print(f"estimate   {size_text(guess.bytes_written)} ({between})")
    print(f"time       {duration_text(guess.least_s)} to {duration_text(guess.most_s)}, by a few images made here")
    if (other := quicker(plan, pace)) is not None:
        words, seconds = other
        print(f"without    Blender, with --set {words}: about {duration_text(seconds)}, and other pixels")
    free = free_memory_bytes()
    here = "" if free is None else f"; {size_text(free)} are free here"
    usual = size_text(usual_memory_bytes(plan))
    print(f"memory     {size_text(memory_bytes(plan))} or more in each process, usually about {usual}{here}")


def render_lines(plan: "Plan") -> Iterator[str]:
    """Yield a line for each render; where there are many, one for all of a scene that move its path."""
    moved: dict[str, list[Render]] = {}
    grouped = len(plan.renders) > MOST_RENDERS
    for render in plan.renders:
        if grouped and render.moving:
            moved.setdefault(render.scene.name, []).append(render)
        else:
            settings = [sequence.setting.name for sequence in render.sequences]
            yield f"{render.name}: {counted(len(render.frames), 'frame')}, {enumerated(settings)}"
    for scene, renders in moved.items():
        settings = [sequence.setting.name for render in renders for sequence in render.sequences]
        frames = counted(sum(len(render.frames) for render in renders), "frame")
        yield f"{scene}, {counted(len(renders), 'render')} along other paths: {frames}, {enumerated(settings)}"


def enumerated(settings: list[str]) -> str:
    """Return settings in words: all of a few, and of many the first ones, the last and how many they are."""
    if len(settings) <= MOST_SETTINGS:
        return f"settings {', '.join(settings)}"
    return f"{len(settings)} settings {', '.join(settings[:4])}, ... {settings[-1]}"
