# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate`: make the dataset that a preset describes, in a folder, at an address, or as a video."""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import MissingDependencyError, StorageError
from ..core.packages import need
from ..core.progress import counted
from .arguments import (
    Parser,
    add_executor_options,
    add_preset_options,
    add_progress_option,
    out_address,
    out_folder,
    planned,
    positive,
    preset_words,
    settled,
)
from .command import Command
from .entry import Entry, blender_lacks, blender_problem, listener, machine_listener, say, work_on
from .known import KNOWN, list_known
from .plan_text import HELD, list_plan, print_plan

if TYPE_CHECKING:
    from threading import Event

    import numpy as np
    from numpy.typing import NDArray

    from ..core.progress import Progress
    from ..dataset.making import Report
    from ..dataset.plan import Plan
    from ..dataset.sequence import PlannedSequence


LEAST_TIMES, LONG_S = 1.5, 20.0  # from which on a quicker way is told of; chosen

# --- the outcome of a run in one line, for people and for programs ---


def tell_outcome(report: "Report", options: argparse.Namespace) -> None:
    """Print the figures of a run, and send them to a program that listens."""
    print(figures(report))
    if options.progress == "json":
        machine_listener().tell({"result": figures(report)})


def figures(report: "Report") -> str:
    """Return the figures of a run in one line."""
    parts = [f"{counted(report.frames_rendered, 'frame')} rendered"]
    if report.frames_kept:
        parts.append(f"{report.frames_kept} kept")
    if report.frames_per_s is not None:
        parts.append(f"{report.frames_per_s:.2f} frames/s")
        parts.append(f"loading {report.loading_s:.1f} s")
    if report.rays_per_px is not None:
        parts.append(f"{report.rays_per_px:.2f} rays a pixel")
    if report.decoding_share is not None:
        parts.append(f"decoding {100 * report.decoding_share:.0f} % of the processor's time")
    parts.append(f"{report.total_s:.1f} s in all")
    if report.peak_memory_bytes is not None:
        parts.append(f"peak memory {report.peak_memory_bytes / 1e6:.0f} MB")
    return ", ".join(parts)


def _generate_options(parser: Parser) -> None:
    add_preset_options(parser)
    parser.flag("--overwrite", "replace the dataset that is in DIR")
    parser.flag("--dry-run", "print what would be done, and do nothing")
    parser.option(
        "--list WHAT",
        "list this preset's scenes, settings or sequences (default), or a line for each of what 'noisy-world list' "
        "knows; then end",
        nargs="?",
        const="sequences",
        choices=[*KNOWN, *HELD],
    )
    message = "processes that render (default: 1); no more than there are processors and frames"
    add_executor_options(parser, "shard", 1, message, cpus=2)
    parser.option(
        "--shards N",
        "with --ray: about how many shards, at least one a render (default: of two minutes each, by the estimate)",
        type=positive,
    )
    add_progress_option(parser)


def _settle_generate(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    return settled(parser, options, known=options.list in KNOWN or options.worker)


def _generate(options: argparse.Namespace, entry: Entry) -> int:
    """Carry out the options."""
    if options.worker:
        from .shard_workers import ready_for_shards

        return work_on(ready_for_shards)
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
    from .shard_workers import make_dataset

    progress, stop = listener(options.progress)
    if options.progress == "text" and (hint := quicker_hint(plan)):
        say(hint)
    if (address := out_address(options)) is None and is_video(out_folder(options)):
        return generate_videos(plan, options, entry, progress, stop)
    report = make_dataset(plan, options, entry, progress, stop, partial(need_blender, plan, entry))
    for written in [address] if address else _written(plan, out_folder(options)):
        print(f"wrote {written}")
    for item in plan.refused:
        print(f"left out {item.folder}: {item.setting} {item.why}")
    tell_outcome(report, options)
    return 0


def quicker_hint(plan: "Plan") -> str:
    """Return a line on what takes much less time, of a plan that takes long; "" where nothing does."""
    from ..dataset.estimate import AS_MEASURED, estimate, quicker

    if (other := quicker(plan, AS_MEASURED)) is None:
        return ""
    words, seconds = other
    times = estimate(plan).seconds / seconds
    if times < LEAST_TIMES or seconds * times < LONG_S:
        return ""
    return f"without Blender it takes about 1/{times:.1f} of the time, with other pixels: --set {words}"


def _written(plan: "Plan", out: Path) -> list[Path]:
    """Return what of a dataset in a folder is told: the sequences' folders and the contact sheet."""
    folders = [out / sequence.folder for sequence in plan.sequences if sequence.frames]
    return [*folders, *([out / "overview.png"] if plan.preset.spec.output.overview else [])]


def generate_videos(
    plan: "Plan", options: argparse.Namespace, entry: Entry, progress: "Progress", stop: "Event"
) -> int:
    """Make videos of the sequences' colour, and print the outcome."""
    from .shard_workers import make_dataset

    out = out_folder(options)
    videos = videos_of(plan, out, overwrite=options.overwrite)
    reports: list[Report] = []
    need = partial(need_blender, plan, entry)
    make_videos(
        plan,
        videos,
        lambda folder: reports.append(make_dataset(plan, options, entry, progress, stop, need, folder=folder)),
    )
    for path in videos.values():
        print(f"wrote {path}")
    tell_outcome(reports[0], options)
    return 0


def need_blender(plan: "Plan", entry: Entry) -> None:
    """Raise MissingDependencyError where a plan's frames cannot be made for want of Blender."""
    if plan.needs_blender and (problem := blender_problem(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))


def _without_blender(plan: "Plan") -> str:
    """Return what makes a plan's frames without Blender, as the end of a line; "" where nothing does."""
    if not plan.renders_in_blender:
        return "; or add --set render.backend=reference, which needs no Blender"
    capabilities = [scene.source.capabilities for scene in plan.scenes]
    if any(
        item.rendered and item.own is not None for item in capabilities
    ):  # only Blender knows their materials and lights
        return ""
    backend = " render.backend=reference" if plan.composites else ""
    return f"; or add --set render.engine=embree{backend}, which needs no Blender but the extra embree"


def need_packages(plan: "Plan", options: argparse.Namespace, entry: Entry) -> None:
    """Raise NoisyWorldError where a package, a library or memory that a run needs is missing. Starts nothing."""
    from ..dataset.estimate import check_memory

    if options.ray is None:
        check_memory(plan)
    if plan.needs_blender and (problem := blender_lacks(entry)):
        raise MissingDependencyError(problem + _without_blender(plan))
    if "embree" in plan.engines:
        from ..render.embree import embree_version

        embree_version()
    if (address := out_address(options)) is not None:
        from ..dataset.packing import need_writer
        from ..dataset.store import open_store

        need_writer(open_store(address))
    if options.ray is not None:
        need(["ray"], "cluster", for_what="--ray")


def _again(options: argparse.Namespace, _: list[str]) -> list[str] | None:
    """Return the arguments that repeat a run whose preset and folder are named."""
    if options.preset is None or options.out is None:
        return None
    words = preset_words(options)
    words += ["--jobs", str(options.jobs)] if options.jobs > 1 else []
    if options.ray is not None:
        words += ["--ray", options.ray, "--cpus", str(options.cpus)]
        words += ["--shards", str(options.shards)] if options.shards is not None else []
    return words


# --- a video to look at, without keeping the dataset ---


def is_video(out: Path) -> bool:
    """Tell whether a place for a dataset names a video."""
    from ..images.video_files import WRITTEN

    return out.suffix.lower() in WRITTEN and not out.is_dir()


def videos_of(plan: "Plan", out: Path, *, overwrite: bool) -> dict[str, Path]:
    """Return the video of each sequence by its folder: one of the name given; of several, one with each's name.

    Raises StorageError where one is there already, and where there is no colour.
    """
    if "rgb" not in plan.format.modalities:
        raise StorageError("a video shows colour, and output.modalities leaves it out", file=out)
    if plan.format.of_light:
        raise StorageError("a video shows colour, and output.image exr is light", file=out, remedy="set it to png")
    made = [sequence for sequence in plan.sequences if sequence.frames]
    videos = {item.folder: out if len(made) == 1 else _named(out, item) for item in made}
    there = next((path for path in videos.values() if path.exists()), None)
    if there is not None and not overwrite:
        raise StorageError("is there already", file=there, remedy="--overwrite replaces it")
    return videos


def make_videos(plan: "Plan", videos: dict[str, Path], make: Callable[[Path], object]) -> None:
    """Make the dataset in a folder beside the videos, write these, and remove it. make: makes it in a folder."""
    import numpy as np

    from ..core.atomic_files import ELSEWHERE, storage_errors
    from ..images.video_files import write_video

    beside = next(iter(videos.values())).parent
    with storage_errors(beside, ELSEWHERE):
        beside.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=".noisy_world-", dir=beside)
    with folder as name:
        out = Path(name) / "dataset"
        make(out)
        for render in plan.renders:
            stamps = render.scene.source.frame_stamps
            gaps_s = np.diff(stamps.rgb.seconds)
            rate_hz = 1 / float(np.median(gaps_s)) if gaps_s.size else 30.0
            for sequence in (item for item in render.sequences if item.folder in videos):
                names = [out / sequence.folder / plan.format.names(stamps).rgb(frame) for frame in sequence.frames]
                video = videos[sequence.folder]
                made = Path(name) / video.name  # moved when it is whole
                write_video(made, _colours(names), rate_hz)
                with storage_errors(video, ELSEWHERE):
                    made.replace(video)


def _colours(files: list[Path]) -> "Iterator[NDArray[np.uint8]]":
    import cv2
    import numpy as np

    from ..images.image_files import read_pixels

    for file in files:
        yield np.asarray(read_pixels(file, cv2.IMREAD_COLOR_RGB), np.uint8)


def _named(out: Path, sequence: "PlannedSequence") -> Path:
    return out.with_name(f"{out.stem}-{sequence.folder.replace('/', '-')}{out.suffix}")


GENERATE = Command(
    name="generate",
    order=10,
    group="make a dataset",
    help="make the RGB-D dataset that a preset describes",
    description="Make the RGB-D dataset that a preset describes.",
    epilog="The same command again resumes a run that was stopped: finished frames are kept, and the result is the "
    "same to the byte. In a Blender program: blender -b -P headless/generate.py -- PRESET [options].",
    options=_generate_options,
    settle=_settle_generate,
    run=_generate,
    again=_again,
)

COMMAND = GENERATE
