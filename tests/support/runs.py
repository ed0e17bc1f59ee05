# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets that are planned, rendered from, and made into datasets in the test's own process."""

import sys
import threading
from contextlib import contextmanager

from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.plan import Plan, make_plan
from noisy_world.dataset.rendering import open_render, render_options, source_paths
from noisy_world.dataset.run import Run
from noisy_world.preset.keys import read_preset


def planned(preset, *, frames=None, overrides=()):
    """The plan of a preset's file."""
    return make_plan(read_preset(preset, overrides), frames)


def run(preset, out, *, frames=None, overrides=(), progress=None, stop=None, **options):
    """Make the dataset of a preset, or of a plan; return the report. options: of the run."""
    plan = preset if isinstance(preset, Plan) else make_plan(read_preset(preset, overrides), frames)
    listener = progress or PlainProgress(sys.stderr)
    return Run(plan, out, progress=listener, stop=stop or threading.Event(), **options).make_dataset()


def files_made(preset, out, **several):
    """Make the dataset; return the bytes of its files by name, but for run.json, which holds timings."""
    run(preset, out, **several)
    files = (path for path in sorted(out.rglob("*")) if path.is_file() and path.name != "run.json")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


@contextmanager
def opened_render(plan, tell=print, *, exposing=False):
    """What gives the frames of a plan's only render, and the paths of its sensors.

    exposing: as its settings expose them, rather than each an instant.
    """
    (render,) = plan.renders
    sensors, options = source_paths(plan, render), render_options(plan, render)
    with render.scene.source.prepare(render.camera, tell) as prepared:
        if exposing:
            yield open_render(prepared, render, sensors, options, tell), sensors
        else:
            yield prepared.open(sensors, options, tell), sensors
