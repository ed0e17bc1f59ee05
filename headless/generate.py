# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the dataset that a preset describes.

    python headless/generate.py presets/demo.yaml
    blender -b -P headless/generate.py -- presets/demo.yaml

Both take the same options and write the same dataset; the second runs inside a Blender program.
"""

import argparse
import json
import os
import shlex
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING

# A Blender program does not look beside the script.
sys.path.insert(0, str(Path(__file__).resolve().parent))

from installation import INSTALLED, ROOT, inside_blender, prepare_imports

SCRIPT = Path(__file__).resolve()
INTERRUPTED = 130
KNOWN = ("keys", "layouts", "perturbations", "presets")  # what can be listed without a preset

if TYPE_CHECKING:
    from noisy_world.core.planning.plan import Plan
    from noisy_world.core.progress import JsonProgress, Progress
    from noisy_world.pipeline import Report


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    prepare_imports()
    from noisy_world.core.requirements import NEEDED  # noqa: PLC0415 - found just now

    options = parse_arguments(arguments)
    if problem := missing_package(NEEDED):
        return fail(problem, options)
    from noisy_world.core.errors import InterruptedRunError, NoisyWorldError  # noqa: PLC0415

    try:
        return run(options)
    except InterruptedRunError:
        say(f"stopped; what is finished stays, and the same command goes on from there:\n  {own_command(options)}")
        return INTERRUPTED
    except NoisyWorldError as error:
        return fail(str(error), options)


def missing_package(names: Iterable[str]) -> str:
    """Say which package cannot be had and the command that gets it; nothing where all are there."""
    from noisy_world.core.requirements import install_remedy, missing_packages, missing_sentence  # noqa: PLC0415

    missing = missing_packages(names)
    if not missing:
        return ""
    where = "this Blender's " if inside_blender() else ""
    if INSTALLED:
        return missing_sentence(missing, where, f"enable the add-on, or {install_remedy(ROOT)}")
    if where:
        binary = sys.modules["bpy"].app.binary_path
        return missing_sentence(missing, where, f"run: make -C {ROOT} blender-env BLENDER={binary}")
    return missing_sentence(missing, where, f"run: make -C {ROOT} venv, then use {ROOT / '.venv/bin/python'}")


def blender_problem() -> str:
    """Import Blender; say which system libraries it lacks, if that is why it cannot be."""
    try:
        import bpy  # noqa: F401, PLC0415 - the first to need it
    except ImportError as error:
        from system_libraries import advice, missing_libraries  # noqa: PLC0415 - seldom needed

        if names := missing_libraries():
            return advice(names)
        return f"bpy cannot be imported: {error}"
    return ""


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    """Parse the command line; exits with a usage line where it is wrong."""
    parser = argparse.ArgumentParser(
        prog="generate.py",
        description="Make the RGB-D dataset that a preset describes.",
        epilog="The same command again resumes a run that was stopped: finished frames are kept, and the result is the "
        "same to the byte. In a Blender program: blender -b -P headless/generate.py -- PRESET [options].",
    )
    parser.add_argument("preset", metavar="PRESET", nargs="?", type=Path, help="the preset, a YAML file")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="the dataset's folder (default: out/<name of the preset>)"
    )
    parser.add_argument(
        "--set",
        metavar="KEY.PATH=VALUE",
        action="append",
        default=[],
        nargs="+",
        dest="overrides",
        help="change a key of the preset, e.g. render.samples=4 or scenes.0.name=kitchen; may be repeated",
    )
    parser.add_argument(
        "--frames",
        metavar="A:B",
        type=frame_slice,
        help="only frames A to B-1 of each trajectory; they keep their numbers, and other frames that are there stay",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the dataset that is in DIR")
    parser.add_argument("--dry-run", action="store_true", help="print what would be done, and do nothing")
    parser.add_argument(
        "--list",
        metavar="WHAT",
        nargs="?",
        const="sequences",
        choices=[*KNOWN, "scenes", "settings", "sequences"],
        help="list keys (all that a preset may say), layouts (of the files), perturbations (with their parameters and "
        "severities), presets (those shipped), or this preset's scenes, settings or sequences (default); then end",
    )
    parser.add_argument("--jobs", metavar="N", type=positive, default=1, help="processes that render (default: 1)")
    parser.add_argument(
        "--progress",
        choices=["text", "json"],
        default="text",
        help="how a run tells that it goes on: text on standard error for people (default), or for programs lines of "
        "JSON on standard output, each behind '@noisy-world '",
    )
    parser.add_argument("--worker", metavar="K", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    options.overrides = [text for group in options.overrides for text in group]
    if options.preset is None and options.overrides and "=" not in options.overrides[-1]:
        options.preset = Path(options.overrides.pop())  # a preset behind --set is no override
    if options.preset is None and options.list not in KNOWN:
        parser.error("name a preset, presets/demo.yaml for instance")
    return options


def frame_slice(text: str) -> slice:
    """Parse A:B."""
    start, colon, stop = text.partition(":")
    if not colon or not all(part == "" or part.isdecimal() for part in (start, stop)):
        raise argparse.ArgumentTypeError(f"{text!r} has to be A:B, two frame numbers of which either may be left out")
    return slice(int(start) if start else None, int(stop) if stop else None)


def positive(text: str) -> int:
    """Parse a number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} has to be a whole number from 1 up")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Do what the command line asks."""
    from noisy_world.core.planning.plan import make_plan  # noqa: PLC0415
    from noisy_world.core.presets.preset import read_preset  # noqa: PLC0415
    from noisy_world.perturbations import registry  # noqa: PLC0415

    if options.list in KNOWN:
        return list_known(options.list)
    preset = read_preset(options.preset, options.overrides)
    plan = make_plan(preset, options.frames, registry())
    if options.list:
        return list_plan(plan, options.list)
    if options.dry_run:
        return print_plan(plan, out_folder(options))
    if options.worker is not None:
        return take_part(plan, options)
    return generate(plan, options)


def out_folder(options: argparse.Namespace) -> Path:
    """Return where the dataset goes."""
    return options.out if options.out is not None else Path("out") / options.preset.stem


def list_known(what: str) -> int:
    """List what does not depend on a preset."""
    from noisy_world.core.presets.preset import PresetSpec  # noqa: PLC0415
    from noisy_world.core.schema import list_keys  # noqa: PLC0415

    if what == "presets":
        for path in sorted((ROOT / "presets").rglob("*.yaml")):
            print(path.relative_to(ROOT))
        return 0
    if what == "layouts":
        return list_layouts()
    if what == "perturbations":
        return list_perturbations()
    rows = list(list_keys(PresetSpec))
    width = max(len(name) for name, _ in rows)
    for name, meaning in rows:
        print(f"{name:<{width}}  {meaning}")
    return 0


def list_layouts() -> int:
    """List every layout with its images, colours (of both the default first) and depth scale."""
    from noisy_world.core.datasets.layouts import LAYOUTS  # noqa: PLC0415
    from noisy_world.core.presets.preset import OutputSpec  # noqa: PLC0415

    for layout in LAYOUTS.values():
        print(f"{layout.name}  {layout.label}, {layout.meaning}")
        print(f"    images {' or '.join(layout.images)}; colour {' or '.join(layout.colours)}")
        farthest_m = OutputSpec(layout=layout.name).format.depth_limit_m
        print(f"    depth in 16 bits, {layout.depth_scale_per_m:g} steps a metre: up to {farthest_m:.1f} m")
    return 0


def list_perturbations() -> int:
    """List every perturbation with its parameters, their ranges and their values at severities 1 to 5."""
    from noisy_world.core.schema import list_keys  # noqa: PLC0415
    from noisy_world.perturbations import registry  # noqa: PLC0415

    for item in registry().values():
        print(f"{item.name}  ({item.category}; {item.label})")
        for name, meaning in list_keys(item.parameters):
            levels = item.severities.get(name)
            at = f"; severities 1 to 5: {', '.join(f'{value:g}' for value in levels)}" if levels else ""
            print(f"    {name}: {meaning}{at}")
    return 0


def list_plan(plan: "Plan", what: str) -> int:
    """List what a preset holds."""
    if what == "scenes":
        for render in plan.renders:
            scene = render.scene
            source = scene.existing.folder if scene.existing else scene.mesh_path or scene.spec.mesh
            print(f"{render.name}  {len(render.frames)} frames  {source}")
    elif what == "settings":
        for setting in plan.settings:
            print(setting.name)
    else:
        for sequence in plan.sequences:
            print(sequence.folder)
    return 0


def print_plan(plan: "Plan", out: Path) -> int:
    """Print what a run would do."""
    from noisy_world.core.planning.plan import estimate  # noqa: PLC0415

    guess = estimate(plan)
    camera = plan.camera
    print(f"preset     {plan.preset.path} (SHA-256 {plan.preset.sha256[:12]})")
    print(f"dataset    {out} ({plan.format.layout.name} layout, {plan.format.image} and 16-bit png)")
    print(f"camera     {camera.width_px} x {camera.height_px}, fx {camera.fx_px:g}, fy {camera.fy_px:g}")
    print(f"sequences  {len(plan.sequences)}")
    for render in plan.renders:
        settings = ", ".join(sequence.setting.name for sequence in render.sequences)
        print(f"  {render.name}: {len(render.frames)} frames, settings {settings}")
    print(f"renders    {len(plan.renders)}, {plan.frame_count} frames in all")
    print(f"estimate   {guess.bytes_written / 1e6:.0f} MB, {duration(guess.seconds)} on two cores (rough)")
    return 0


def duration(seconds: float) -> str:
    """Say a time as a person would."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"


def generate(plan: "Plan", options: argparse.Namespace) -> int:
    """Make the dataset, and say what came of it."""
    from noisy_world.pipeline import Run  # noqa: PLC0415
    from workers import run_workers  # noqa: PLC0415

    if plan.needs_blender and (problem := missing_package(["bpy"]) or blender_problem()):
        other = "" if plan.renders_anything else "; or add --set render.backend=reference, which needs no Blender"
        return fail(problem + other, options)
    out = out_folder(options)
    progress, stop = listener(options)
    make = Run(
        plan,
        out,
        progress=progress,
        stop=stop,
        overwrite=options.overwrite,
        jobs=options.jobs,
        workers=lambda pieces, listener: run_workers(
            [command(options, worker=number) for number in range(len(pieces))], pieces, listener, stop
        ),
    )
    report = make()
    for sequence in (item for item in plan.sequences if item.frames):
        print(f"wrote {out / sequence.folder}")
    if plan.preset.spec.output.overview:
        print(f"wrote {out / 'overview.png'}")
    print(figures(report))
    if options.progress == "json":
        machine_listener().tell({"result": figures(report)})
    return 0


def listener(options: argparse.Namespace) -> "tuple[Progress, threading.Event]":
    """Return who hears how the run goes on, and what stops it."""
    from noisy_world.core.progress import PlainProgress, TerminalProgress  # noqa: PLC0415

    if options.progress == "json":
        stop = stop_on_signal(None)
        return machine_listener(stop.set), stop
    # A copy of the stream: Blender's own lines are turned away from the descriptor 1 while it renders.
    stream = os.fdopen(os.dup(sys.stderr.fileno()), "w", buffering=1)
    # A terminal that does not know its size shows no bar.
    watched = stream.isatty() and os.get_terminal_size(stream.fileno()).lines > 1
    return (TerminalProgress(stream) if watched else PlainProgress(stream)), stop_on_signal(stream)


def machine_listener(lost: Callable[[], object] = lambda: None) -> "JsonProgress":
    """Return the program that started this one, as a listener; `lost` is called when it is gone."""
    from noisy_world.core.progress import JsonProgress  # noqa: PLC0415

    sys.stdout.flush()
    return JsonProgress(os.fdopen(os.dup(1), "w", buffering=1), lost=lost)


def take_part(plan: "Plan", options: argparse.Namespace) -> int:
    """Render the frames that are named on standard input, for the process that started this one."""
    from noisy_world.pipeline import Run  # noqa: PLC0415
    from workers import Parent, work_for  # noqa: PLC0415

    parent = Parent()
    stop = stop_on_signal(None)
    run_ = Run(plan, out_folder(options), progress=parent, stop=stop, jobs=options.jobs)
    return work_for(parent, run_, json.load(sys.stdin), options.worker)


def figures(report: "Report") -> str:
    """Say the figures of a run in a line."""
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


def stop_on_signal(stream: IO[str] | None) -> threading.Event:
    """Let Ctrl-C and a batch system's SIGTERM end the run after the frame in hand; a second Ctrl-C ends it at once."""
    stop = threading.Event()

    def handle(number: int, _: FrameType | None) -> None:
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()
        if stream is not None:
            print("\nstopping after the frames in hand", file=stream, flush=True)

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop


def own_command(options: argparse.Namespace, *, worker: int | None = None) -> str:
    """Return the command line that does the same again, for a person to paste."""
    return shlex.join(command(options, worker=worker))


def command(options: argparse.Namespace, *, worker: int | None = None) -> list[str]:
    """Return the command that does the same again, or a worker's part of it."""
    words = [str(options.preset), "--out", str(out_folder(options))]
    if options.overrides:
        words += ["--set", *options.overrides]
    if options.frames is not None:
        words += [
            "--frames",
            f"{options.frames.start or 0}:{'' if options.frames.stop is None else options.frames.stop}",
        ]
    words += ["--jobs", str(options.jobs)] if options.jobs > 1 else []
    words += ["--worker", str(worker)] if worker is not None else []
    if inside_blender():
        return [sys.modules["bpy"].app.binary_path, "-b", "-P", str(SCRIPT), "--", *words]
    return [sys.executable, str(SCRIPT), *words]


def say(text: str) -> None:
    """Print a line for a person."""
    print(text, file=sys.stderr, flush=True)


def fail(text: str, options: argparse.Namespace) -> int:
    """Say what is wrong; return the exit status of a user's error."""
    say(f"generate.py: {text}")
    if options.progress == "json":
        machine_listener().tell({"error": text})
    return 1


def script_arguments() -> list[str]:
    """Return the command line's arguments; in a Blender program, those after --."""
    if not inside_blender():
        return sys.argv[1:]
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []


if __name__ == "__main__":
    # Blender would go on after a script's exception, with status 0.
    try:
        status = main(script_arguments())
    except KeyboardInterrupt:
        status = INTERRUPTED
    except Exception:  # noqa: BLE001 - a bug keeps its traceback
        traceback.print_exc()
        status = 70
    sys.exit(status)
