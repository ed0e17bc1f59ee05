# SPDX-License-Identifier: GPL-3.0-or-later
"""`threshold`: search for the value of a perturbation at which a system's success falls to one half."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import add_isolate_option, add_progress_option, add_set_option, number, positive, settled
from .command import Command, as_given
from .entry import Entry
from .parser import Parser
from .part import add_part_options, data_folder
from .places import folder, path
from .shipped import no_such_preset

if TYPE_CHECKING:
    from ..core.presets.preset import Preset
    from ..core.progress import Progress
    from ..evaluation.thresholds.search import Found, Planned, Trial
    from ..evaluation.thresholds.trials import Trials

WIDTH, MOST = 0.15, 80


def _threshold_options(parser: Parser) -> None:
    parser.add_argument("preset", metavar="PRESET", nargs="?", type=path, help="the preset whose scenes are used")
    parser.add_argument(
        "--system",
        metavar="NAMES",
        required=True,
        help="the system: the name of one that is shipped, or a YAML file of your own; several with commas between",
    )
    parser.add_argument("--perturbation", metavar="NAME", required=True, help="the perturbation")
    parser.add_argument(
        "--parameter",
        metavar="NAME",
        help="its number that is searched (default: its severity, from 1 to 5 and between; or its only number)",
    )
    table = "where severities set it: a factor of 4 beyond that of severity"
    parser.add_argument(
        "--from", metavar="VALUE", dest="mild", type=float, help=f"the mildest value (default, {table} 1)"
    )
    parser.add_argument("--to", metavar="VALUE", dest="worst", type=float, help=f"the worst (default, {table} 5)")
    parser.add_argument(
        "--with",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="given",
        help="another key of the perturbation, translation_m=0 for instance; may be repeated",
    )
    parser.add_argument(
        "--success",
        metavar="METRIC",
        default="success_10cm",
        help="what counts as a success: a metric that is 0 or 1 (default: success_10cm, an ATE below 10 cm with 80 %% "
        "of the frames tracked)",
    )
    parser.add_argument(
        "--width",
        metavar="SHARE",
        type=_share,
        default=WIDTH,
        help=f"how wide the interval may be, as a share of the way from the mildest to the worst (default: {WIDTH})",
    )
    parser.add_argument(
        "--most", metavar="N", type=positive, default=MOST, help=f"the search ends after so many runs (default: {MOST})"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=folder,
        help="the folder of thresholds, in which each search has one of its own (default: out/NAME-thresholds)",
    )
    add_set_option(parser)
    add_part_options(parser, ("scenes",))  # the preset's settings are not used
    add_isolate_option(parser)
    add_progress_option(parser)


def _share(text: str) -> float:
    return number(text, "a number between 0 and 1, 0.15 for instance", lambda value: 0.0 < value < 1.0)


def _find_thresholds(options: argparse.Namespace, entry: Entry) -> int:
    """Search for each system, write the thresholds of the folder, and print what was found."""
    from ..core.datasets.storage import FolderLock
    from ..core.extras import need
    from ..core.perturbing.sweeps import known_perturbation
    from ..core.schema import ConfigPath
    from ..evaluation.study.made_origin import MadeOrigin
    from ..evaluation.study.results import ResultsFolder
    from ..evaluation.systems.checking import check_system
    from ..evaluation.systems.registry import find_systems, isolating
    from ..evaluation.thresholds.axis import axis_of
    from ..evaluation.thresholds.table import write_thresholds
    from ..evaluation.thresholds.trials import Trials, check_success, preset_of
    from ..perturbations import registry
    from .generate import need_blender, need_packages
    from .running import listener

    need(("matplotlib",), "evaluate")
    kind = known_perturbation(options.perturbation, ConfigPath("--perturbation"), registry())
    check_success(options.success)
    axis = axis_of(kind, options.parameter, options.mild, options.worst)
    preset = preset_of(_preset(options), axis, _given(options.given, axis.parameter))
    systems = isolating(find_systems(options.system.split(","), "--system"), options.isolate)
    for system in systems:
        check_system(system)
    out = Path("out") / f"{options.preset.resolve().stem}-thresholds" if options.out is None else options.out
    results = ResultsFolder(out.resolve() / axis.name)
    progress, stop = listener(options.progress)
    origin = MadeOrigin(preset, (), results, stop=stop)
    need_packages(origin.whole, argparse.Namespace(out=None, ray=None), entry)
    need_blender(origin.whole, entry)
    lock = FolderLock(results.work / "lock")
    scenes = {scene.name: scene.frame_count for scene in origin.whole.scenes}
    try:
        for system in systems:
            found = _search(Trials(origin, results, system, axis, options.success, stop), scenes, options, progress)
            print(f"{system.name}, {axis.name}: {found.text()}", flush=True)
        for scene in scenes:
            origin.finished(scene)
    finally:
        results.tidy(alone=True)
        lock.release()
    for file in write_thresholds(out):
        print(f"wrote {file}")
    return 0


def _search(trials: "Trials", scenes: dict[str, int], options: argparse.Namespace, progress: "Progress") -> "Found":
    """Search with one system; what is made is written after each trial. scenes: how many frames each has."""
    from ..evaluation.thresholds.search import scene_of, search
    from ..evaluation.thresholds.trials import SearchFile

    file = SearchFile(trials.results, trials.system.name)
    identity = trials.identity
    before = file.trials(identity)
    made = list(before)

    def carry_out(planned: "Planned") -> "Trial":
        trial = trials.make(planned, progress)
        made.append(trial)
        file.write(identity, made)
        progress.note(_line(trials.axis.text(trial.value), trial))
        progress.advance(scenes[trial.scene])
        return trial

    names, seed = list(scenes), trials.origin.preset.spec.seed
    frames = [scenes[scene_of(number, names, seed)] for number in range(options.most)]
    label = f"searching with {trials.system.name}, at most {options.most} runs"
    progress.start(label, sum(frames), sum(frames[: len(before)]))
    try:
        found = search(trials.axis, names, seed, before, carry_out, width=options.width, most=options.most)
    finally:
        progress.finish()
    file.write(identity, made, found)
    return found


def _line(value: str, trial: "Trial") -> str:
    error = "no error" if trial.ate_m is None else f"ATE {1000 * trial.ate_m:.1f} mm"
    ended_ = "success" if trial.succeeded else "no success"
    return f"run {trial.number + 1}, {trial.scene}, {value}: {ended_} ({error}, {trial.tracked_share:.0%} tracked)"


def _preset(options: argparse.Namespace) -> "Preset":
    """Return the preset. Raises InputError where it is not there or wrong."""
    from ..core.presets.preset import read_preset

    if not options.preset.exists():
        raise no_such_preset(options.preset)
    return read_preset(options.preset, options.overrides, data=data_folder(options), scenes=options.scenes)


def _given(texts: list[str], searched: str) -> dict[str, Any]:
    """Return the keys that --with gives. Raises NoisyWorldError."""
    from ..core.errors import NoisyWorldError
    from ..core.yaml_reading import read_yaml

    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise NoisyWorldError(f"--with {text}: has to be KEY=VALUE, translation_m=0 for instance")
        if name == searched:
            raise NoisyWorldError(f"--with {text}: {name} is what is searched", remedy="leave it out")
        found[name] = read_yaml(value, "--with", name)
    return found


THRESHOLD = Command(
    name="threshold",
    group="evaluate SLAM systems",
    help="search for the value of a perturbation at which a system's success falls to one half",
    description="Search for the value of a perturbation at which a system's success falls to one half: run after "
    "run, each with the value that tells most, on a sequence of another scene of the preset, with noise of its "
    "own.",
    epilog="The same command again resumes a search that was stopped. The preset's settings are not used; "
    "docs/thresholds.md says how a threshold is found.",
    options=_threshold_options,
    settle=settled,
    run=_find_thresholds,
    stopped="the runs that have ended stay, and the same command goes on from there",
    again=as_given,
)
