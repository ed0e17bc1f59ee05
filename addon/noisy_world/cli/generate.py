# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate`: make the dataset that a preset describes."""

import argparse
from typing import TYPE_CHECKING

from ..core.extras import need
from .arguments import out_address, out_folder, parse_arguments, preset_words
from .ending import CONTINUES, ended
from .entry import Entry
from .listing import KNOWN, list_known, list_plan, print_plan
from .missing import blender_lacks, blender_problem
from .outcome import tell_outcome
from .part import planned

if TYPE_CHECKING:
    from pathlib import Path
    from threading import Event

    from ..core.planning.plan import Plan
    from ..core.progress import Progress
    from ..pipeline.report import Report


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = parse_arguments(arguments, entry)
    again = "" if options.preset is None or options.out is None else f":\n  {entry.pasteable(own_arguments(options))}"
    return ended(lambda: do(options, entry), entry, stopped=CONTINUES + again, options=options)


def do(options: argparse.Namespace, entry: Entry) -> int:
    """Carry out the options."""
    if options.worker:
        return work()
    if options.list in KNOWN:
        return list_known(options.list)
    plan = planned(options)
    if options.list:
        return list_plan(plan, options.list)
    if options.dry_run:
        print_plan(plan, out_address(options) or out_folder(options))
        need_packages(plan, options, entry)
        return 0
    return generate(plan, options, entry)


def generate(plan: "Plan", options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset, and print the outcome."""
    from .as_video import is_video
    from .running import listener

    need_blender(plan, entry)
    if out_address(options) is not None:
        return generate_there(plan, options, entry)
    out = out_folder(options)
    progress, stop = listener(options.progress)
    if is_video(out):
        return generate_videos(plan, options, entry, progress, stop)
    if options.ray is None:
        report = make_here(plan, options, entry, progress, stop)
    else:
        from .ray_workers import make_on_ray

        report = make_on_ray(plan, options, progress, stop)
    for sequence in (item for item in plan.sequences if item.frames):
        print(f"wrote {out / sequence.folder}")
    if plan.preset.spec.output.overview:
        print(f"wrote {out / 'overview.png'}")
    tell_outcome(report, options)
    return 0


def generate_videos(
    plan: "Plan", options: argparse.Namespace, entry: Entry, progress: "Progress", stop: "Event"
) -> int:
    """Make videos of the sequences' colour, and print the outcome."""
    from .as_video import make_videos, videos_of

    out = out_folder(options)
    videos = videos_of(plan, out, overwrite=options.overwrite)
    reports: list[Report] = []
    make_videos(
        plan, videos, lambda folder: reports.append(make_here(plan, options, entry, progress, stop, folder=folder))
    )
    for path in videos.values():
        print(f"wrote {path}")
    tell_outcome(reports[0], options)
    return 0


def generate_there(plan: "Plan", options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset at an address, and print the outcome."""
    from ..core.errors import StorageError
    from .at_address import run_at, told_of
    from .running import listener
    from .workers import Workers, useful_jobs

    if options.overwrite:
        raise StorageError("--overwrite replaces datasets in folders; choose another address with --out")
    progress, stop = listener(options.progress)
    if options.ray is not None:
        from .ray_workers import make_on_ray

        return told_of(make_on_ray(plan, options, progress, stop), options)
    jobs, told = useful_jobs(options.jobs, plan.frame_count)
    if told:
        progress.note(told)
    run = run_at(plan, options, progress, stop, jobs)
    workers = Workers(entry.command(["--worker"]), plan, run.folder, jobs=jobs, stop=stop)
    return told_of(run.make_dataset(workers.make), options)


def make_here(
    plan: "Plan",
    options: argparse.Namespace,
    entry: Entry,
    progress: "Progress",
    stop: "Event",
    *,
    folder: "Path | None" = None,
) -> "Report":
    """Make the dataset on this machine. folder: where, if not where the options say."""
    from ..pipeline.run import Run
    from .workers import Workers, useful_jobs

    out = folder or out_folder(options)
    jobs, told = useful_jobs(options.jobs, plan.frame_count)
    if told:
        progress.note(told)
    workers = Workers(entry.command(["--worker"]), plan, out, jobs=jobs, stop=stop)
    run = Run(plan, out, progress=progress, stop=stop, overwrite=options.overwrite, jobs=jobs, workers=workers.make)
    return run.make_dataset()


def need_blender(plan: "Plan", entry: Entry) -> None:
    """Raise MissingDependencyError where a plan's frames cannot be made for want of Blender."""
    from ..core.errors import MissingDependencyError

    if plan.needs_blender and (problem := blender_problem(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))


def _without_blender(plan: "Plan") -> str:
    """Return what makes a plan's frames without Blender, as the end of a line; "" where nothing does."""
    if not plan.renders_in_blender:
        return "; or add --set render.backend=reference, which needs no Blender"
    gives = [scene.source.gives for scene in plan.scenes]
    if any(item.rendered and item.own is not None for item in gives):  # only Blender knows their materials and lights
        return ""
    backend = " render.backend=reference" if plan.composites else ""
    return f"; or add --set render.engine=embree{backend}, which needs no Blender but the extra embree"


def need_packages(plan: "Plan", options: argparse.Namespace, entry: Entry) -> None:
    """Raise MissingDependencyError where a package or library that a run needs is missing. Starts nothing."""
    from ..core.errors import MissingDependencyError

    if plan.needs_blender and (problem := blender_lacks(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))
    if "embree" in plan.engines:
        from ..rays.embree import embree_version

        embree_version()
    if (address := out_address(options)) is not None:
        from ..storage.address import open_address

        open_address(address)
    if options.ray is not None:
        need(["ray"], "cluster", for_what="--ray")


def work() -> int:
    """Make shards for the process that started this one, which names them on standard input."""
    from .running import stop_on_signal
    from .workers import CommandReader, Parent, carry_out

    stop = stop_on_signal(None)
    return carry_out(CommandReader(stop), Parent(), stop)


def own_arguments(options: argparse.Namespace) -> list[str]:
    """Return the arguments that repeat this run."""
    words = preset_words(options)
    words += ["--jobs", str(options.jobs)] if options.jobs > 1 else []
    if options.ray is not None:
        words += ["--ray", options.ray, "--cpus", str(options.cpus)]
        words += ["--shards", str(options.shards)] if options.shards is not None else []
    return words
