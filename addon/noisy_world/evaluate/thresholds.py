# SPDX-License-Identifier: GPL-3.0-or-later
"""Thresholds: the value of a perturbation at which a system's success falls to one half, and tables of many."""

import json
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors
from ..core.errors import InputError, NoisyWorldError, StorageError
from ..core.progress import Progress
from ..core.schema import ConfigPath, KeyInfo, allowed_range, number_text, unknown_name
from ..core.streams import stream
from ..dataset.folder_state import first_difference
from ..perturbations.kinds import Perturbation
from ..preset.keys import Preset, check_document
from .cases import Case, SystemRun
from .figures import GREY, Picture, drawing, line_styles, shortened, svg_bytes, unused
from .metrics import METRICS
from .report_sections import Section
from .report_tables import NOTHING, SHARED, Column, Table, cell_text
from .study_results import FOR_PEOPLE, STRICT, ResultsFolder, score_run
from .study_sequences import PresetOrigin
from .study_tables import csv_text
from .system_runs import run_system
from .systems import System

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# The values of a perturbation among which a threshold is searched, from the mildest to the worst.


SEVERITY = "severity"
OF_SEVERITY = KeyInfo("severity", minimum=1, maximum=5)
PLACES = 31
"""At most so many values are tried. Chosen: a fifth of the asked width apart, or less."""
BEYOND = 4.0
"""How far a search goes beyond the values of severities 1 and 5 where nothing is said, as a factor. Chosen."""
DIGITS = 4


@dataclass(frozen=True)
class Axis:
    """A parameter's values. mild, worst: its ends; either may be the larger. whole: whether they are whole numbers.

    logarithmic: whether places between the ends are in proportion to the value's logarithm.
    """

    perturbation: str
    parameter: str
    unit: str
    mild: float
    worst: float
    logarithmic: bool
    whole: bool

    @property
    def name(self) -> str:
        """Its name, which is a folder's too."""
        return f"{self.perturbation}.{self.parameter}"

    def value_at(self, place: float) -> float:
        """Return the value at a place, from 0 (the mildest) to 1 (the worst)."""
        low, high = self._scaled(self.mild), self._scaled(self.worst)
        scaled = low + place * (high - low)
        return math.exp(scaled) if self.logarithmic else scaled

    def place_of(self, value: float) -> float:
        """Return the place of a value."""
        low, high = self._scaled(self.mild), self._scaled(self.worst)
        return (self._scaled(value) - low) / (high - low)

    def tried(self) -> list[float]:
        """Return the values that may be tried, from the mildest to the worst, each once."""
        values = [
            self.mild,
            *(self._rounded(self.value_at(k / (PLACES - 1))) for k in range(1, PLACES - 1)),
            self.worst,
        ]
        return list(dict.fromkeys(values))

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{number_text(float(f'{value:.3g}'))}{f' {self.unit}' if self.unit else ''}"

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value

    def _rounded(self, value: float) -> float:
        return round(value) if self.whole else float(f"{value:.{DIGITS}g}")


def axis_of(kind: Perturbation, parameter: str | None, mild: float | None, worst: float | None) -> Axis:
    """Return the axis of a perturbation's parameter.

    parameter: None for the severity or, where it has none, its only number that is not a later one. mild, worst: None
    for what the table of severities says and BEYOND. Raises InputError and NoisyWorldError in a line that names the
    option.
    """
    hints = get_type_hints(kind.parameters)
    known: dict[str, KeyInfo] = {
        item.name: item.metadata["key"] for item in fields(kind.parameters) if hints[item.name] in (int, float)
    }
    if parameter is None:
        parameter = _usual(kind, known)
    if parameter == SEVERITY and kind.severities:
        info, table = OF_SEVERITY, (1.0, 5.0)
    elif parameter in known:
        info, table = known[parameter], kind.severities.get(parameter, ())
    else:
        names = [*([SEVERITY] if kind.severities else []), *known]
        raise unknown_name(ConfigPath("--parameter"), f"number of {kind.name}", parameter, names)
    whole = hints.get(parameter) is int
    for option, value in (("--from", mild), ("--to", worst)):
        if whole and value is not None and not value.is_integer():
            problem = f"{option}: {value:g} is no value of {kind.name}.{parameter}"
            raise NoisyWorldError(problem, remedy="give a whole number")
    mild, worst = _ends(f"{kind.name}.{parameter}", info, [float(value) for value in table], (mild, worst))
    logarithmic = parameter != SEVERITY and min(mild, worst) > 0
    return Axis(kind.name, parameter, info.unit, mild, worst, logarithmic, whole)


def _usual(kind: Perturbation, numbers: dict[str, KeyInfo]) -> str:
    if kind.severities:
        return SEVERITY
    if len(first := [name for name, info in numbers.items() if not info.later]) == 1:
        return first[0]
    raise NoisyWorldError(f"{kind.name} has no severity", remedy=f"name one of {', '.join(numbers)} with --parameter")


def _ends(
    name: str, info: KeyInfo, table: list[float], given: tuple[float | None, float | None]
) -> tuple[float, float]:
    """Return the mildest and the worst value. name: of the parameter. table: its values at severities."""
    (mild, worst), allowed = given, allowed_range(info)
    steps = len(table) > 1 and table[0] != table[-1]
    if mild is None or worst is None:
        if not steps:
            says = f"no severities say which values of {name} are mild and which are worse"
            raise NoisyWorldError(says, remedy=f"give both --from, the mildest, and --to, the worst ({allowed})")
        factor = 1.0 if info is OF_SEVERITY else BEYOND if table[-1] > table[0] else 1.0 / BEYOND
        mild = _within(info, table[0] / factor) if mild is None else mild
        worst = _within(info, table[-1] * factor) if worst is None else worst
    for option, value in (("--from", mild), ("--to", worst)):
        if (
            not math.isfinite(value)
            or value != _within(info, value)
            or (info.above is not None and value <= info.above)
        ):
            raise NoisyWorldError(f"{option}: {value:g} is no value of {name}", remedy=f"allowed: {allowed}")
    if mild == worst:
        raise NoisyWorldError(f"--from and --to are both {mild:g}", remedy="give two values between which to search")
    if steps and (worst - mild) * (table[-1] - table[0]) < 0:
        order = f"{name} is worse the {'larger' if table[-1] > table[0] else 'smaller'} it is"
        raise NoisyWorldError(f"--from {mild:g} --to {worst:g}: {order}", remedy="give the milder value with --from")
    return mild, worst


def _within(info: KeyInfo, value: float) -> float:
    value = value if info.minimum is None else max(value, info.minimum)
    return value if info.maximum is None else min(value, info.maximum)


# Where success falls to one half: a psychometric function, its posterior on a grid, and the most telling next trial.
#
# The chance that a system fails at a place u, from 0 (the mildest value of a search) to 1 (the worst), is
#
#     P(u) = g + (1 - g - l) logistic(b (u - t) + c),    c = logit((1/2 - g) / (1 - g - l)),
#
# so that it is one half at the threshold t, whatever the slope b and the lapses: g of the runs fail where nothing is
# done, l succeed whatever is done. The posterior of (t, b, g, l) is kept on a grid (Kontsevich and Tyler, "Bayesian
# adaptive estimation of psychometric slope and threshold", Vision Research 39, 1999); the next trial is at the place
# after which the entropy of t alone is expected to be least, as slope and lapses are a nuisance here (Prins, "The
# psi-marginal adaptive method", Journal of Vision 13(7):3, 2013; Watson, "QUEST+", Journal of Vision 17(3):10, 2017).


Float64: TypeAlias = NDArray[np.float64]

STEP = 0.0125
THRESHOLDS = np.round(np.arange(-0.5, 1.5 + STEP / 2, STEP), 6)
"""(T,): what the threshold may be; beyond 0 and 1 it is not in the range that is searched."""
RISES = np.geomspace(0.02, 1.5, 8)
"""What it takes for the chance to rise from a tenth to nine tenths, without lapses. Chosen."""
LAPSES = (0.005, 0.03, 0.08)
"""Of each kind, with equal weights. Chosen."""
RISE_LOGITS = 2.0 * np.log(9.0)
LEVEL = 0.95


def chance_of_failure(places: Float64, threshold: float, rise: float, fails: float, holds: float) -> Float64:
    """Return P(u) (S,) at places (S,). rise: from a tenth to nine tenths. fails, holds: lapses g and l."""
    middle = (0.5 - fails) / (1.0 - fails - holds)
    logit = RISE_LOGITS / rise * (places - threshold) + np.log(middle / (1.0 - middle))
    return fails + (1.0 - fails - holds) / (1.0 + np.exp(-np.clip(logit, -700.0, 700.0)))


@cache
def chances(places: tuple[float, ...]) -> Float64:
    """Return P (T, S, N) of each threshold, each of the S places, and each combination of rise and lapses."""
    rest = [(rise, fails, holds) for rise in RISES.tolist() for fails in LAPSES for holds in LAPSES]
    at = np.array(places)
    table = [[chance_of_failure(at, threshold, *each) for each in rest] for threshold in THRESHOLDS.tolist()]
    return np.ascontiguousarray(np.moveaxis(np.array(table), 2, 1))


def prior(known: Float64) -> Float64:
    """Return the posterior before the first trial (T, N): all alike. known: what `chances` returned."""
    thresholds, _, others = known.shape
    return np.full((thresholds, others), 1.0 / (thresholds * others))


def updated(posterior: Float64, chance: Float64, *, failed: bool) -> Float64:
    """Return the posterior (T, N) after a trial. chance: (T, N), of a failure at its place."""
    product = posterior * (chance if failed else 1.0 - chance)
    return product / product.sum()


def next_place(posterior: Float64, known: Float64) -> int:
    """Return which of the S places the trial is at after which the threshold's entropy is expected to be least."""
    fails = np.matmul(known, posterior[:, :, None])[:, :, 0].T  # (S, T): joint with a failure
    # Sums differ in their last digits from machine to machine, and equals must not.
    return int(np.argmin(np.round(_entropy(fails) + _entropy(posterior.sum(axis=1) - fails), 9)))


def _entropy(joint: Float64) -> Float64:
    """(S, T) of one outcome -> (S,): the entropy of the threshold after it, times the outcome's chance."""
    joint = np.maximum(joint, 1e-300)
    return (joint * np.log(joint.sum(axis=1, keepdims=True) / joint)).sum(axis=1)


def quantile(posterior: Float64, share: float) -> float:
    """Return the threshold below which a share of the posterior lies; each grid point stands for STEP around it."""
    below = np.concatenate([[0.0], np.cumsum(posterior.sum(axis=1))])
    edges = np.append(THRESHOLDS - STEP / 2, THRESHOLDS[-1] + STEP / 2)
    return float(np.interp(share, below / below[-1], edges))


def interval(posterior: Float64) -> tuple[float, float]:
    """Return the ends between which the threshold lies with a probability of LEVEL, with equal shares on both sides."""
    return quantile(posterior, (1.0 - LEVEL) / 2.0), quantile(posterior, (1.0 + LEVEL) / 2.0)


# The search for a threshold: trial after trial, each where it tells most, until the interval is narrow enough.
#
# What was tried before decides the next trial, and nothing else does, so a search that is taken up again is the same.


FEWEST_RUNS = 10
"""Before a search ends without a threshold. Chosen."""
FEWEST_TO_FIND = 25
"""Before a threshold is found. Chosen: fewer outcomes do not tell how gradual the rise is, and an interval that allows
for any is too wide where it is abrupt and too narrow where it is gradual."""
NARROW_IN_A_ROW = 3
"""Runs after which the interval is narrow enough, one after the other. Chosen: a search that ended at the first would
end where chance has made it narrow."""


@dataclass(frozen=True)
class Planned:
    """A trial that is to be made. number: from 0; seed: of its path and its noise."""

    number: int
    scene: str
    seed: int
    value: float


@dataclass(frozen=True)
class Trial:
    """A trial that was made. outcome: how the run ended. ate_m: None where it has none. succeeded: as asked for."""

    number: int
    scene: str
    seed: int
    value: float
    outcome: str
    ate_m: float | None
    tracked_share: float
    succeeded: bool

    @property
    def planned(self) -> Planned:
        """What it was to be."""
        return Planned(self.number, self.scene, self.seed, self.value)


class Verdict(StrEnum):
    """What a search found."""

    FOUND = "found"  # the interval is as narrow as asked
    ENDED = "ended"  # it is wider: no more runs were allowed
    HOLDS = "holds"  # the threshold, if there is one, lies beyond the worst value
    FAILS = "fails"  # the threshold lies before the mildest value


@dataclass(frozen=True)
class SearchResult:
    """What a search found. threshold, mild, worst: with the interval's ends; None where not in what was searched."""

    axis: Axis
    verdict: Verdict
    runs: int
    threshold: float | None
    mild: float | None
    worst: float | None

    def text(self) -> str:
        """Return it in a sentence."""
        axis, runs = self.axis, f"{self.runs} runs"
        if self.verdict is Verdict.HOLDS:
            return f"more than half succeed at the worst value too, {axis.text(axis.worst)}; no threshold ({runs})"
        if self.verdict is Verdict.FAILS:
            return f"half or more fail at the mildest value too, {axis.text(axis.mild)}; no threshold ({runs})"
        ends = f"{100 * LEVEL:.0f} %: {self._end(self.mild, axis.mild, 'before')} to "
        ends += self._end(self.worst, axis.worst, "beyond")
        ending = "is not found" if self.threshold is None else f"is {axis.text(self.threshold)}"
        wide = ", which is wider than asked for" if self.verdict is Verdict.ENDED else ""
        return f"the threshold {ending} ({ends}{wide}; {runs})"

    def _end(self, value: float | None, end: float, side: str) -> str:
        return f"{side} {self.axis.text(end)}" if value is None else self.axis.text(value)


def scene_of(number: int, scenes: Sequence[str], seed: int) -> str:
    """Return the scene of a trial: all of them in a drawn order, then all in another, so that each comes as often."""
    round_, place = divmod(number, len(scenes))
    return scenes[int(stream("threshold", "scenes", seed, frame=round_).permutation(len(scenes))[place])]


def search(
    axis: Axis,
    scenes: Sequence[str],
    seed: int,
    made: Sequence[Trial],
    carry_out: Callable[[Planned], Trial],
    *,
    width: float,
    most: int,
) -> SearchResult:
    """Search, and return what was found.

    scenes: names. seed: of the first trial; each takes the next. made: trials of before, which are not made again.
    carry_out: makes one, and keeps it. width: of the interval, as a share of the axis. most: runs. Raises StorageError
    where `made` is of another search, and whatever carry_out raises.
    """
    values = axis.tried()
    known = chances(tuple(map(axis.place_of, values)))
    posterior = prior(known)
    verdict = Verdict.ENDED
    runs = narrow = 0
    while runs < most and verdict is Verdict.ENDED:
        place = next_place(posterior, known)
        planned = Planned(runs, scene_of(runs, scenes, seed), seed + runs, values[place])
        if runs < len(made) and made[runs].planned != planned:
            raise StorageError(f"trial {runs} of those that were made is of another search", remedy="begin anew")
        trial = made[runs] if runs < len(made) else carry_out(planned)
        posterior = updated(posterior, known[:, place], failed=not trial.succeeded)
        runs += 1
        low, high = interval(posterior)
        narrow = narrow + 1 if low >= 0.0 and high <= 1.0 and high - low <= width else 0
        if runs >= FEWEST_RUNS and low >= 1.0:
            verdict = Verdict.HOLDS
        elif runs >= FEWEST_RUNS and high <= 0.0:
            verdict = Verdict.FAILS
        elif (runs >= FEWEST_TO_FIND and narrow >= NARROW_IN_A_ROW) or (runs == most and narrow):
            verdict = Verdict.FOUND
    low, high = interval(posterior)
    middle, low, high = (
        axis.value_at(end) if 0.0 <= end <= 1.0 else None for end in (quantile(posterior, 0.5), low, high)
    )
    return SearchResult(axis, verdict, runs, middle, low, high)


# The trials of a search: a short sequence with one value of a perturbation, a run of the system on it, its score.
#
# Every trial has a seed of its own, which decides its noise. Its path is its scene's.


ENDING = ".threshold.json"
KIND = "search of a threshold of Noisy World"
FORMAT = 1  # raised when the file's keys change


def preset_of(preset: Preset, axis: Axis, given: Mapping[str, Any]) -> Preset:
    """Return a preset with a setting for each value that may be tried, instead of its own.

    given: the perturbation's other keys. Raises InputError where the perturbation does not take these.
    """
    kept = {key: part for key, part in preset.document.items() if key != "only"}
    only = {} if preset.spec.only.scenes is None else {"only": {"scenes": list(preset.spec.only.scenes)}}
    settings = [
        {"name": setting_of(axis, value), "perturb": [{axis.perturbation: {**given, axis.parameter: value}}]}
        for value in axis.tried()
    ]
    return check_document({**kept, **only, "settings": settings}, preset.path)


def setting_of(axis: Axis, value: float) -> str:
    """Return the name of the setting with a value."""
    return f"{axis.perturbation}_{axis.parameter}_{value:g}"


def check_success(name: str) -> None:
    """Raise InputError where no metric of this name tells success from failure."""
    known = [item for item in METRICS if item.startswith("success_") and item != "success_auc"]
    if name not in known:
        raise unknown_name(ConfigPath("--success"), "metric of success", name, known)


@dataclass(frozen=True)
class SearchFile:
    """The file of a search: what decides its trials, the trials, and what was found once it has ended.

    results: the folder of the searches along one axis, of one system each.
    """

    results: ResultsFolder
    system: str

    @property
    def path(self) -> Path:
        """Where it lies."""
        return self.results.folder / f"{self.system}{ENDING}"

    def read(self) -> dict[str, Any] | None:
        """Return its content; None where it is not there. Raises StorageError."""
        if not self.path.is_file():
            return None
        content = self.results.read_json(self.path)
        if not isinstance(content, dict) or content.get("kind") != KIND or content.get("format") != FORMAT:
            problem = "is no search of this version of Noisy World"
            raise StorageError(problem, file=self.path, remedy="remove it")
        return content

    def trials(self, identity: Mapping[str, Any]) -> list[Trial]:
        """Return the trials that were made. Raises StorageError where they are of another search, or damaged."""
        content = self.read()
        if content is None:
            return []
        if difference := first_difference(content.get("identity"), identity, ""):
            remedy = "choose another folder with --out"
            raise StorageError(f"holds another search: {difference}", file=self.path, remedy=remedy)
        rows, names = content.get("trials"), {item.name for item in fields(Trial)}
        if not isinstance(rows, list) or not all(isinstance(row, dict) and set(row) == names for row in rows):
            raise StorageError("is not as it was written", file=self.path, remedy="remove it")
        return [Trial(**row) for row in rows]

    def write(self, identity: Mapping[str, Any], trials: list[Trial], result: SearchResult | None = None) -> None:
        """Write it anew. Raises StorageError."""
        content = {"kind": KIND, "format": FORMAT, "identity": identity, "trials": [asdict(item) for item in trials]}
        self.results.write_json(self.path, {**content, "found": None if result is None else asdict(result)})


@dataclass(frozen=True)
class Trials:
    """Makes the trials of a search. success: the metric that is 1 for a success. stop: ends a trial when set."""

    origin: PresetOrigin
    results: ResultsFolder
    system: System
    axis: Axis
    success: str
    stop: threading.Event

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the trials, as plain JSON values."""
        kept = {key: part for key, part in self.origin.identity.items() if key not in FOR_PEOPLE}
        content = {
            "axis": asdict(self.axis),
            "sequences": kept,
            "success": self.success,
            "system": {"name": self.system.name, "digest": self.system.digest},
        }
        return json.loads(json.dumps(content))

    def make(self, planned: Planned, progress: Progress) -> Trial:
        """Make the sequence of a trial, run the system on it, score it, and remove the sequence.

        Raises InterruptedRunError where `stop` is set.
        """
        case = Case(planned.scene, setting_of(self.axis, planned.value), planned.seed)
        run = SystemRun(case, self.system.name, 1)
        folder = self.results.of_run(run)
        self.results.remove(folder)  # what a run that was killed has left
        with self.origin.sequence(case, progress) as sequence:
            record = run_system(self.system, sequence.folder, folder, stop=self.stop, names=run.placeholders)
            monocular = self.system.reads.monocular
            scored = score_run(folder, record, sequence.truth, protocol=STRICT, monocular=monocular)
        values = scored.content[STRICT]
        if values[self.success] is None:
            raise InputError(self.origin.preset.path, f"{planned.scene} has a path that stands still", where="scenes")
        return Trial(
            **asdict(planned),
            outcome=str(record.outcome),
            ate_m=values["ate_rmse_m"],
            tracked_share=values["tracked_share"],
            succeeded=values[self.success] == 1.0,
        )


# The thresholds of a folder of searches: a table, and a figure by system in the physical unit.


# Thresholds by system: a panel for each parameter of a perturbation, in its unit.


WIDE_IN, ACROSS = 7.2, 2
ROW_IN, HEAD_IN = 0.3, 0.75


@dataclass(frozen=True)
class ThresholdBar:
    """What was found of a system."""

    system: str
    found: SearchResult


def thresholds(bars: Sequence[ThresholdBar]) -> Picture:
    """Draw each threshold with its interval; an arrow stands for what lies beyond what was searched."""
    panels: dict[str, list[ThresholdBar]] = {}
    for bar in bars:
        panels.setdefault(bar.found.axis.name, []).append(bar)
    styles = line_styles(sorted({bar.system for bar in bars}))
    about = (
        "The value at which success falls to one half, of each system, with its 95 % interval; to the right is worse. "
        "A grey line is the range that was searched. An arrow: the threshold, or an end of its interval, lies beyond."
    )
    rows = math.ceil(len(panels) / ACROSS)
    height_in = rows * (HEAD_IN + ROW_IN * max(map(len, panels.values()), default=0))
    with drawing(WIDE_IN, height_in) as figure:
        axes = figure.subplots(rows, ACROSS, squeeze=False).ravel().tolist()
        for panel, item in zip(axes, panels.values(), strict=False):
            _panel(panel, item, styles)
        unused(axes, len(panels))
        return Picture("thresholds", "Where success falls to one half", about, svg_bytes(figure))


def _panel(panel: "Axes", bars: list[ThresholdBar], styles: dict[str, tuple[str, str]]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis = bars[0].found.axis
    if all(bar.found.axis.logarithmic for bar in bars):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    for row, bar in enumerate(bars):
        _row(panel, row, bar.found, *styles[bar.system])
    panel.set_yticks(range(len(bars)), [shortened(bar.system, 24) for bar in bars])
    panel.set_ylim(len(bars) - 0.4, -0.6)
    panel.set_title(f"{axis.perturbation}: {axis.parameter}{f' [{axis.unit}]' if axis.unit else ''}", loc="left")
    if axis.worst < axis.mild:
        panel.invert_xaxis()


def _row(panel: "Axes", row: int, result: SearchResult, colour: str, marker: str) -> None:
    axis = result.axis
    panel.plot([axis.mild, axis.worst], [row, row], color=GREY, linewidth=0.5, alpha=0.6, zorder=1)
    if result.verdict in (Verdict.HOLDS, Verdict.FAILS):
        end = axis.worst if result.verdict is Verdict.HOLDS else axis.mild
        _arrow(panel, row, end, colour, outward=_outward(result, end), hollow=True)
        return
    ends = [axis.mild if result.mild is None else result.mild, axis.worst if result.worst is None else result.worst]
    panel.plot(ends, [row, row], color=colour, linewidth=2.0, zorder=2, solid_capstyle="butt")
    for value, end in ((result.mild, axis.mild), (result.worst, axis.worst)):
        if value is None:
            _arrow(panel, row, end, colour, outward=_outward(result, end), hollow=False)
    if result.threshold is not None:
        panel.plot([result.threshold], [row], marker=marker, color=colour, markersize=5, linestyle="", zorder=3)


def _outward(result: SearchResult, end: float) -> str:
    """Return the marker that points out of the range at one of its ends; to the right is worse."""
    return ">" if end == result.axis.worst else "<"


def _arrow(panel: "Axes", row: int, at: float, colour: str, *, outward: str, hollow: bool) -> None:
    face = "white" if hollow else colour
    panel.plot([at], [row], marker=outward, color=colour, markerfacecolor=face, markersize=9, linestyle="", zorder=4,
               clip_on=False)  # fmt: skip


COLUMNS = (
    *("perturbation", "parameter", "unit", "system", "verdict", "threshold", "mild_end", "worst_end", "runs"),
    *("searched_from", "searched_to", "success"),
)


@dataclass(frozen=True)
class SystemThreshold:
    """What a search that has ended found, of a system. success: the metric."""

    system: str
    found: SearchResult
    success: str


def read_thresholds(folder: Path) -> list[SystemThreshold]:
    """Return what the searches in a folder have found, by perturbation and system. Raises StorageError."""
    thresholds: list[SystemThreshold] = []
    for file in sorted(folder.glob(f"*/*{ENDING}")):
        content = SearchFile(ResultsFolder(file.parent), file.name.removesuffix(ENDING)).read()
        if content is not None and content["found"] is not None:
            identity, values = content["identity"], content["found"]
            at = {**values, "axis": Axis(**values["axis"]), "verdict": Verdict(values["verdict"])}
            thresholds.append(SystemThreshold(identity["system"]["name"], SearchResult(**at), identity["success"]))
    return sorted(thresholds, key=lambda item: (item.found.axis.name, item.system))


def drawn(systems: list[SystemThreshold]) -> Picture:
    """Draw thresholds by system, a panel for each parameter."""
    return thresholds([ThresholdBar(item.system, item.found) for item in systems])


def write_thresholds(folder: Path) -> list[Path]:
    """Write thresholds.csv and thresholds.svg from the searches in a folder; return the files. Raises StorageError."""
    thresholds = read_thresholds(folder)
    files = {
        "thresholds.csv": csv_text(map(row_of, thresholds), COLUMNS).encode(),
        "thresholds.svg": drawn(thresholds).svg,
    }
    for name, data in files.items():
        with storage_errors(folder / name):
            (folder / name).write_bytes(data)
    return [folder / name for name in files]


def row_of(item: SystemThreshold) -> dict[str, Any]:
    """Return a row of the table, by COLUMNS."""
    result, axis = item.found, item.found.axis
    return {
        "perturbation": axis.perturbation,
        "parameter": axis.parameter,
        "unit": axis.unit,
        "system": item.system,
        "verdict": str(result.verdict),
        "threshold": result.threshold,
        "mild_end": result.mild,
        "worst_end": result.worst,
        "runs": result.runs,
        "success": item.success,
        "searched_from": axis.mild,
        "searched_to": axis.worst,
    }


# Where each system breaks, from searches for thresholds that were kept in the study's folder.


FOLDER = "thresholds"
"""In a results folder, that of the searches."""
TABLE_DIGITS = 3


def threshold_text(row: Mapping[str, Any]) -> str:
    """Return what was found, of a row of the table: "14.9 [11.6, 18.8] frames", or beyond which value it lies."""
    unit = f" {row['unit']}" if row["unit"] else ""
    mildest, worst = (cell_text(row[name], TABLE_DIGITS) for name in ("searched_from", "searched_to"))
    if row["verdict"] == Verdict.HOLDS:
        return f"beyond {worst}{unit}"
    if row["verdict"] == Verdict.FAILS:
        return f"before {mildest}{unit}"
    threshold, low, high = (cell_text(row[name], TABLE_DIGITS) for name in ("threshold", "mild_end", "worst_end"))
    low = f"before {mildest}" if low == NOTHING else low
    high = f"beyond {worst}" if high == NOTHING else high
    return f"{threshold} [{low}, {high}]{unit}"


COLUMNS_SHOWN = (
    *(SHARED["perturbation"], Column("parameter", "parameter"), SHARED["system"]),
    Column(
        "threshold",
        "threshold",
        meaning="the value at which success falls to one half; in brackets its 95 % interval",
        text=threshold_text,
    ),
    Column("runs", "runs", meaning="that the search took"),
    Column("success", "success", meaning="the metric that says what a success is"),
)


def threshold_section(results: Path) -> Section | None:
    """Return what the searches in a results folder have found; None where none has ended. Raises StorageError."""
    import pandas as pd

    thresholds = read_thresholds(results / FOLDER)
    if not thresholds:
        return None
    frame = pd.DataFrame(list(map(row_of, thresholds)), columns=list(COLUMNS))
    caption = "The value of a perturbation at which a system's success falls to one half, with its 95 % interval."
    table = Table(FOLDER, "Where each system breaks", caption, frame, COLUMNS_SHOWN)
    return Section(FOLDER, "Thresholds", pictures=[drawn(thresholds)], tables=[table])
