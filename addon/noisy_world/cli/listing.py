# SPDX-License-Identifier: GPL-3.0-or-later
"""Listing what a preset may say, from keys to perturbations, the presets that are shipped, and what a preset holds."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.progress import duration_text
from .shipped import shipped_presets

if TYPE_CHECKING:
    from ..core.planning.plan import Plan, Render

HELD = ("scenes", "settings", "sequences")  # what a preset holds
MOST_RENDERS = 20  # that a dry run lists one by one
MOST_SETTINGS = 12  # of a render that it names


def list_presets() -> None:
    """List the presets that are shipped."""
    for name in shipped_presets():
        print(name)


def list_preset_keys() -> None:
    """List every key that a preset may have, with its meaning, unit, range and default."""
    from ..sources import preset_keys

    rows = dict(preset_keys())
    width = max(map(len, rows))
    for name, meaning in rows.items():
        print(f"{name:<{width}}  {meaning}")


def list_sources() -> None:
    """List where a preset's scenes may come from, and the keys of each: its own, and whether it has a trajectory."""
    from ..core.schema import list_keys
    from ..sources import SOURCES

    for name, kind in SOURCES.items():
        print(f"{name}  {kind.label}: {kind.meaning}{SOURCES.origin(name)}")
        rows = [row for row in list_keys(kind.keys) if row[0] != "name" and not row[0].startswith("trajectory.")]
        for key, meaning in sorted(rows, key=lambda row: row[0].partition(".")[0] != name):
            print(f"    {key}: {meaning}")


def list_channels() -> None:
    """List what a camera gives for a frame, and how its files hold it."""
    from ..core.channels import CHANNELS

    width = max(map(len, CHANNELS))
    for name, item in CHANNELS.items():
        print(f"{name:<{width}}  {item.meaning}: {item.convention}{CHANNELS.origin(name)}")


def list_cameras() -> None:
    """List the real cameras that a preset may name as `device`: what they stand for, and where the figures are from."""
    from ..core.camera_devices import CAMERA_DEVICES
    from ..core.schema import yaml_text

    for name, device in CAMERA_DEVICES.items():
        print(f"{name}  {device.label}: {device.meaning}")
        print(f"    camera: {yaml_text(device.camera)}")
        print(f"        {device.sources['lens']}")
        for step, values in device.steps.items():
            print(f"    {step}: {yaml_text(dict(values))}")
            print(f"        {device.sources[step]}")


def list_layouts() -> None:
    """List every layout with its image kinds, its colours (the default of each first) and its depth scale.

    Then those of recordings that are read alone, and the files that each is told by.
    """
    from ..core.datasets.layouts import EVERY, LAYOUTS, RECORDED
    from ..core.presets.output import OutputSpec

    for layout in LAYOUTS.values():
        print(f"{layout.name}  {layout.label}, {layout.meaning}{EVERY.origin(layout.name)}")
        print(f"    images {' or '.join(layout.images)}; colour {' or '.join(layout.colours)}")
        farthest_m = OutputSpec(layout=layout.name).format.depth_limit_m
        print(f"    depth in 16 bits, {layout.depth_scale_per_m:g} steps a metre: up to {farthest_m:.1f} m")
    print("\nread alone, as sequence: FOLDER")
    for layout in RECORDED.values():
        print(f"{layout.name}  {layout.label}: {layout.meaning}{EVERY.origin(layout.name)}")
        print(f"    {layout.files}")


def list_trajectory_formats() -> None:
    """List the formats of files of poses, and how the content of a file tells each."""
    from ..core.trajectories.files import TRAJECTORY_FORMATS

    for name, item in TRAJECTORY_FORMATS.items():
        print(f"{name}  {item.label}: {item.meaning}{TRAJECTORY_FORMATS.origin(name)}")
        print(f"    told by {item.recognised_by}; times: {item.times}")


def list_metrics() -> None:
    """List every metric, of paths by protocol strict and of maps: name, heading, unit, which way is better, meaning."""
    from ..evaluation.maps.names import MAP_METRICS, MAP_PREFIX
    from ..evaluation.metrics import METRICS

    for prefix, metrics in (("", METRICS), (MAP_PREFIX, MAP_METRICS)):
        for name, metric in metrics.items():
            unit = f" [{metric.unit}]" if metric.unit else ""
            better = f", {metric.better} is better" if metric.better else ""
            print(f"{prefix}{name}  {metric.label}{unit}{better}{metrics.origin(name)}")
            print(f"    {metric.meaning}")


def list_perturbations() -> None:
    """List every perturbation in the order of propagation, with its kind, stage, order and parameters.

    Parameters are listed with their ranges and their values at severities 1 to 5.
    """
    from ..core.perturbing.kinds import kind_name
    from ..core.schema import list_keys
    from ..perturbations import registry

    for item in registry().values():
        origin = f"; from {item.distribution}" if item.distribution else ""
        print(f"{item.name}  ({kind_name(item)}, stage {item.stage}, order {item.order}; {item.label}{origin})")
        for name, meaning in list_keys(item.parameters):
            levels = item.severities.get(name)
            at = f"; severities 1 to 5: {', '.join(f'{value:g}' for value in levels)}" if levels else ""
            print(f"    {name}: {meaning}{at}")


_LISTED = {
    "keys": list_preset_keys,
    "sources": list_sources,
    "layouts": list_layouts,
    "formats": list_trajectory_formats,
    "channels": list_channels,
    "cameras": list_cameras,
    "metrics": list_metrics,
    "perturbations": list_perturbations,
    "presets": list_presets,
}
KNOWN = tuple(_LISTED)
"""What can be listed without a preset."""


def list_known(what: str) -> int:
    """List what does not depend on a preset, one of KNOWN."""
    _LISTED[what]()
    return 0


def list_plan(plan: "Plan", what: str) -> int:
    """List what a preset holds."""
    if what == "scenes":
        for render in plan.renders:
            print(f"{render.name}  {len(render.frames)} frames  {render.scene.source.location}")
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
    from ..core.planning.estimate import estimate, size_text
    from ..core.planning.memory import memory_bytes
    from ..core.planning.plan_notes import plan_notes

    guess = estimate(plan)
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
        for text in scene.source.remarks(plan.cameras[scene.name]):
            print(f"note       {scene.name}: {text}")
    print(f"sequences  {len(plan.sequences)} ({counted(plan.scenes, 'scene')}, {counted(plan.settings, 'setting')})")
    for line in render_lines(plan):
        print(f"  {line}")
    print(f"renders    {len(plan.renders)}, {plan.frame_count} frames in all")
    between = f"{size_text(guess.least_bytes)} to {size_text(guess.most_bytes)}, by what the images show"
    took = duration_text(guess.seconds)
    print(f"estimate   {size_text(guess.bytes_written)} ({between}), {took} on two cores (rough)")
    free = free_memory_bytes()
    here = "" if free is None else f"; {size_text(free)} are free here"
    print(f"memory     {size_text(memory_bytes(plan))} or more in each process, and what the scenes take{here}")


def counted(things: Sequence[object], name: str) -> str:
    """Return a number of things in words."""
    return f"{len(things)} {name}{'' if len(things) == 1 else 's'}"


def render_lines(plan: "Plan") -> Iterator[str]:
    """Yield a line for each render; where there are many, one for all of a scene that move its path."""
    moved: dict[str, list[Render]] = {}
    grouped = len(plan.renders) > MOST_RENDERS
    for render in plan.renders:
        if grouped and render.moving:
            moved.setdefault(render.scene.name, []).append(render)
        else:
            settings = [sequence.setting.name for sequence in render.sequences]
            yield f"{render.name}: {len(render.frames)} frames, {enumerated(settings)}"
    for scene, renders in moved.items():
        settings = [sequence.setting.name for render in renders for sequence in render.sequences]
        frames = sum(len(render.frames) for render in renders)
        yield f"{scene}, {counted(renders, 'render')} along other paths: {frames} frames, {enumerated(settings)}"


def enumerated(settings: list[str]) -> str:
    """Return settings in words: all of a few, and of many the first ones, the last and how many they are."""
    if len(settings) <= MOST_SETTINGS:
        return f"settings {', '.join(settings)}"
    return f"{len(settings)} settings {', '.join(settings[:4])}, ... {settings[-1]}"
