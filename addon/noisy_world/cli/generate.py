# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate`: make the dataset that a preset describes."""

import argparse
from typing import TYPE_CHECKING

from ..core.requirements import NEEDED
from .arguments import out_address, out_folder, parse_arguments, preset_words
from .entry import INTERRUPTED, Entry, say
from .listing import KNOWN, list_known, list_plan, print_plan
from .missing import blender_problem, missing_package
from .part import planned

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..pipeline.report import Report


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = parse_arguments(arguments, entry)
    if problem := missing_package(NEEDED, entry):
        return fail(problem, options, entry)
    from ..core.errors import InterruptedRunError, NoisyWorldError

    try:
        return do(options, entry)
    except InterruptedRunError:
        again = entry.pasteable(own_arguments(options))
        say(f"stopped; finished frames stay, and the same command continues from there:\n  {again}")
        return INTERRUPTED
    except NoisyWorldError as error:
        return fail(str(error), options, entry)


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
        return print_plan(plan, out_address(options) or out_folder(options))
    return generate(plan, options, entry)


def generate(plan: "Plan", options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset, and print the outcome."""
    from ..pipeline.run import Run
    from .running import listener, machine_listener
    from .workers import Workers, useful_jobs

    if problem := lacking_blender(plan, entry):
        return fail(problem, options, entry)
    if out_address(options) is not None:
        return generate_there(plan, options, entry)
    out = out_folder(options)
    progress, stop = listener(options.progress)
    jobs, told = useful_jobs(options.jobs, plan.frame_count)
    if told:
        progress.note(told)
    run = Run(
        plan,
        out,
        progress=progress,
        stop=stop,
        overwrite=options.overwrite,
        jobs=jobs,
        workers=Workers(entry.command(["--worker"]), plan, out, jobs=jobs, stop=stop).make,
    )
    report = run.make_dataset()
    for sequence in (item for item in plan.sequences if item.frames):
        print(f"wrote {out / sequence.folder}")
    if plan.preset.spec.output.overview:
        print(f"wrote {out / 'overview.png'}")
    print(figures(report))
    if options.progress == "json":
        machine_listener().tell({"result": figures(report)})
    return 0


def generate_there(plan: "Plan", options: argparse.Namespace, entry: Entry) -> int:
    """Make the dataset at an address, and print the outcome."""
    from .at_address import run_at, told_of
    from .running import listener
    from .workers import Workers, useful_jobs

    if options.overwrite:
        return fail("--overwrite replaces datasets in folders; choose another address with --out", options, entry)
    progress, stop = listener(options.progress)
    jobs, told = useful_jobs(options.jobs, plan.frame_count)
    if told:
        progress.note(told)
    run = run_at(plan, options, progress, stop, jobs)
    workers = Workers(entry.command(["--worker"]), plan, run.folder, jobs=jobs, stop=stop)
    return told_of(figures(run.make_dataset(workers.make)), options)


def lacking_blender(plan: "Plan", entry: Entry) -> str:
    """Return why frames of a plan cannot be made for want of Blender; "" where they can."""
    problem = (missing_package(["bpy"], entry) or blender_problem()) if plan.needs_blender else ""
    if not problem or plan.renders_in_blender:
        return problem
    return f"{problem}; or add --set render.backend=reference, which needs no Blender"


def work() -> int:
    """Make shards for the process that started this one, which names them on standard input."""
    from .running import stop_on_signal
    from .workers import Parent, Told, carry_out

    stop = stop_on_signal(None)
    return carry_out(Told(stop), Parent(), stop)


def figures(report: "Report") -> str:
    """Return the figures of a run in one line."""
    parts = [f"{report.frames_rendered} frames rendered"]
    if report.frames_kept:
        parts.append(f"{report.frames_kept} kept")
    if report.frames_per_s is not None:
        parts.append(f"{report.frames_per_s:.2f} frames/s")
        parts.append(f"loading {report.loading_s:.1f} s")
    parts.append(f"{report.total_s:.1f} s in all")
    if report.peak_memory_bytes is not None:
        parts.append(f"peak memory {report.peak_memory_bytes / 1e6:.0f} MB")
    return ", ".join(parts)


def own_arguments(options: argparse.Namespace) -> list[str]:
    """Return the arguments that repeat this run."""
    words = preset_words(options)
    words += ["--jobs", str(options.jobs)] if options.jobs > 1 else []
    return words


def fail(text: str, options: argparse.Namespace, entry: Entry) -> int:
    """Report what is wrong; return the exit status of a user's error."""
    entry.complain(text)
    if options.progress == "json":
        from .running import machine_listener

        machine_listener().tell({"error": text})
    return 1
