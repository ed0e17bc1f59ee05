# SPDX-License-Identifier: GPL-3.0-or-later
"""What the study found, before anything else: what broke each system, and by how much.

Settings are ranked by the error over clean. Where half of the runs or more failed or are incomplete, there is no path
to speak of, so the setting ranks before all others, by that share, and no ratio is said of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from ..analysis.run_results import complete_runs
from ..metrics.over_clean import OVER_CLEAN
from ..study.cases import CLEAN
from .figures.ranking import Bar, RankPanel, ranking
from .reading import Results, records
from .tables import shown

if TYPE_CHECKING:
    from pandas import DataFrame

    from .figures.drawing import Picture

ERROR = "ate_rmse_m"
MOST_SYSTEMS_SAID = 3
MOST_BARS = 14
DIGITS = 3
NO_BREAK = "\u00a0"
UNLIKE = 4.0  # the largest ratio of single runs over the least from which on both are said


@dataclass(frozen=True)
class Ranked:
    """A setting under a system. over_clean: None where nothing can be compared; ratios: of single runs.

    ate_m, clean_ate_m: the geometric means whose ratio over_clean is.
    """

    setting: str
    runs: int
    failed: int
    incomplete: int
    over_clean: float | None
    ate_m: float
    clean_ate_m: float
    ratios: tuple[float, ...]

    @property
    def broke(self) -> bool:
        """Whether half of the runs or more failed or are incomplete."""
        return 2 * (self.failed + self.incomplete) >= self.runs

    @property
    def endings(self) -> str:
        """How many runs failed or are incomplete; "" where none is."""
        said = [
            f"{word} {count}" for word, count in (("failed", self.failed), ("incomplete", self.incomplete)) if count
        ]
        return f"{', '.join(said)} of {self.runs}" if said else ""

    @property
    def rank(self) -> tuple[float, float, float]:
        """What settings are sorted by, the worst first."""
        share = (self.failed + self.incomplete) / self.runs
        return (-share if self.broke else 0.0, -(self.over_clean or 0.0), -share)


@dataclass(frozen=True)
class SystemFound:
    """What was found of a system. settings: the worst first. clean_runs: how many, of which clean_failed failed.

    compared: whether some clean run is one that others can be compared with. clean_m: the median ATE of the complete
    clean runs, largest: setting and ATE of the largest error of the other complete ones; None where none has one.
    """

    system: str
    settings: tuple[Ranked, ...]
    clean_runs: int
    clean_failed: int
    compared: bool
    clean_m: float | None
    largest: tuple[str, float] | None


def found_of(results: Results, table: "DataFrame") -> list[SystemFound]:
    """Return what was found of each system, that with the worst first. table: over_clean of the analyses."""
    found = [_of_system(results, str(system), table) for system in sorted(set(results.runs["system"]))]
    return sorted(found, key=lambda item: (not item.settings, *(item.settings[0].rank if item.settings else ())))


def sentences(found: Sequence[SystemFound]) -> list[str]:
    """Return a sentence for each system, of the first few."""
    said = [_sentence(item) for item in found[:MOST_SYSTEMS_SAID]]
    more = len(found) - len(said)
    return [*said, *([f"{more} more system{'s' if more > 1 else ''}: see the figure and the tables."] if more else [])]


def ranking_picture(found: Sequence[SystemFound]) -> "Picture | None":
    """Draw the ranking of each system; None where nothing is compared with clean."""
    panels = [
        RankPanel(
            item.system,
            "" if item.clean_m is None else f"clean: {length(item.clean_m)}",
            tuple(_bar(ranked) for ranked in item.settings[:MOST_BARS]),
            max(0, len(item.settings) - MOST_BARS),
        )
        for item in found
        if item.compared and item.settings
    ]
    return ranking(panels) if panels else None


def length(value_m: float) -> str:
    """Return a length of an error as one reads it: in millimetres below a metre."""
    return f"{shown(value_m, DIGITS)}{NO_BREAK}m" if value_m >= 1.0 else f"{shown(1e3 * value_m, DIGITS)}{NO_BREAK}mm"


def times(ratio: float) -> str:
    """Return a ratio as text."""
    return f"\u00d7{NO_BREAK}{shown(ratio, DIGITS if ratio < 1000 else 4)}"


def _of_system(results: Results, system: str, table: "DataFrame") -> SystemFound:
    runs = results.runs[results.runs["system"] == system]
    clean, noisy = runs[runs["perturbation"] == CLEAN], runs[runs["perturbation"] != CLEAN]
    clean_complete = complete_runs(clean)
    ratios: dict[str, list[float]] = {}
    if OVER_CLEAN in noisy:
        for setting, ratio in noisy[["setting", OVER_CLEAN]].itertuples(index=False, name=None):
            ratios.setdefault(setting, []).extend([ratio] if isfinite(ratio) else [])
    settings = [_ranked(row, ratios) for row in records(table[table["system"] == system])]
    clean_m = clean_complete[ERROR].median() if ERROR in clean else float("nan")
    return SystemFound(
        system,
        tuple(sorted(settings, key=lambda ranked: (*ranked.rank, ranked.setting))),
        len(clean),
        int(clean["failed"].sum()),
        OVER_CLEAN in clean and bool(clean[OVER_CLEAN].notna().any()),
        float(clean_m) if isfinite(clean_m) else None,
        _largest(complete_runs(noisy)),
    )


def _largest(runs: "DataFrame") -> tuple[str, float] | None:
    if ERROR not in runs or not runs[ERROR].notna().any():
        return None
    row = runs.sort_values(ERROR, kind="stable", na_position="first").iloc[-1]
    return str(row["setting"]), float(row[ERROR])


def _ranked(row: Mapping[str, Any], ratios: Mapping[str, Sequence[float]]) -> Ranked:
    setting, over = str(row["setting"]), float(row["over_clean"])
    return Ranked(
        setting,
        runs=int(row["n_runs"]),
        failed=int(row["n_failed"]),
        incomplete=int(row["n_incomplete"]),
        over_clean=over if isfinite(over) else None,
        ate_m=float(row["ate_m"]),
        clean_ate_m=float(row["clean_ate_m"]),
        ratios=tuple(ratios.get(setting, ())),
    )


def _bar(ranked: Ranked) -> Bar:
    if ranked.broke or ranked.over_clean is None:
        return Bar(ranked.setting, None, ranked.endings or "no clean run beside it", ranked.broke, ranked.ratios)
    said = f"{times(ranked.over_clean)}{_range(ranked)}{f', {ranked.endings}' if ranked.endings else ''}"
    return Bar(ranked.setting, ranked.over_clean, said, broke=False, runs=ranked.ratios)


def _range(ranked: Ranked) -> str:
    """Return from where to where the ratios of single runs go, where they are not alike."""
    least, most = min(ranked.ratios), max(ranked.ratios)
    return f" ({shown(least, 2)} to {shown(most, 2)})" if most > UNLIKE * least else ""


def _sentence(item: SystemFound) -> str:
    name = item.system
    if not item.settings and item.clean_m is not None:
        return f"{name} was run on clean frames alone: a median ATE of {length(item.clean_m)}."
    if not item.compared:
        return _without_clean(item)
    worst = item.settings[0]
    compared = next((ranked for ranked in item.settings if not ranked.broke and ranked.over_clean is not None), None)
    if worst.broke:
        also = "" if compared is None else f"; of the others, {_ratio(compared)}"
        return f"Worst for {name}: {worst.setting}, where it {_broke(worst)}{also}."
    if compared is None:
        return f"{name} has no setting that can be compared with a clean run."
    if (compared.over_clean or 0.0) < 1.0:
        return f"Nothing made {name} worse than clean: the nearest is {_ratio(compared)}."
    also = f"; it {_broke(compared)}, which no ratio counts" if compared.endings else ""
    return f"Worst for {name}: {_ratio(compared)}{also}."


def _ratio(ranked: Ranked) -> str:
    """Return a setting with its error over clean. It has one."""
    errors = f"{length(ranked.ate_m)} instead of {length(ranked.clean_ate_m)}"
    return f"{ranked.setting}, {times(ranked.over_clean or 0.0)} its error on clean frames ({errors})"


def _broke(ranked: Ranked) -> str:
    endings = (("failed", ranked.failed), ("was incomplete", ranked.incomplete))
    said = [f"{word} in {count}" for word, count in endings if count]
    return f"{' and '.join(said)} of {ranked.runs} run{'s' if ranked.runs > 1 else ''}"


def _without_clean(item: SystemFound) -> str:
    if item.clean_failed and 2 * item.clean_failed >= item.clean_runs:
        beginning = f"{item.system} failed on clean frames already, in {item.clean_failed} of {item.clean_runs} runs"
    elif item.clean_runs:
        beginning = f"{item.system} was incomplete on clean frames already"
    else:
        beginning = f"{item.system} was not run on clean frames"
    if item.largest is None:
        return f"{beginning}, and no other run is complete."
    setting, error_m = item.largest
    return f"{beginning}, so nothing tells what noise did: its largest ATE is {length(error_m)}, {setting}."
