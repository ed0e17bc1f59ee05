# SPDX-License-Identifier: GPL-3.0-or-later
"""All analyses at once: from the tables of runs and of sequences to named tables with captions."""

from typing import TYPE_CHECKING

from ...core.extras import need
from ..metrics.success import IS_INCOMPLETE
from .correlation import indicator_correlations, perturbation_correlations, system_correlations
from .groups import curve_table, grouped_table
from .over_clean import over_clean_table
from .prediction import prediction_tables
from .robustness_table import robustness_table
from .run_results import LEFT_OUT
from .run_table import SETTING, headline_of, measures_of, tidy_runs, tidy_sequences
from .sequences_table import sequences_tables
from .significance import against_clean_table
from .spread import difference_table, spread_table
from .variance import variance_table

if TYPE_CHECKING:
    from pandas import DataFrame

_INTERVALS = (
    "means of errors are geometric; low and high: 95 % for scenes at large; here_low and here_high: for other seeds in "
    "these scenes"
)

CAPTIONS = {
    "over_clean": "ATE over that of the same system on clean frames of the same scenes and seeds: geometric means of n "
    f"runs. Runs that failed, or are incomplete ({IS_INCOMPLETE}), are in no ratio.",
    "spread": f"Every measure of each system and setting, over scenes, seeds and repeats; {_INTERVALS}. {LEFT_OUT}",
    "variance": "Where the spread of errors comes from: the factor by which another scene, another seed and another "
    "run on the same files change an error (exp of a standard deviation), and its share of the variance. Nested random "
    "effects of the logarithms, by moments; freedom: the degrees that a factor stands on. Without repeats a seed's "
    "factor holds the system's own chance, without seeds a scene's holds theirs; all: over the perturbed settings.",
    "differences": f"Every measure against clean, scene by scene; of errors the ratio to it; {_INTERVALS}.",
    "tests": "Tests against clean, two-sided, Holm's correction over settings. Welch's: of logarithms of errors, "
    "without runs that failed or are incomplete; Wilcoxon's: with them as the worst.",
    "curves": f"Failure curves: measures over severity, clean at 0; {_INTERVALS}.",
    "systems": f"Each system over all perturbed settings, which weigh alike in a scene; {_INTERVALS}.",
    "by_perturbation": f"Each system and perturbation over its severities and modes; {_INTERVALS}.",
    "by_mode": f"Each system and mode over perturbations and severities; {_INTERVALS}.",
    "by_severity": f"Each system and severity over perturbations and modes; {_INTERVALS}.",
    "robustness": "Score over the own clean score (mRR), error over the baseline's (mCE); 95 %, bootstrap of scenes.",
    "perturbation_correlations": "Spearman: ATE under two perturbations, over systems, scenes and severities.",
    "system_correlations": "Spearman: ATE of two systems, over scenes and settings; failed and incomplete runs are "
    "worst.",
    "indicator_correlations": "Pearson: ATE, log10 ATE with what sequences are like; Spearman: failed and incomplete "
    "runs as worst.",
    "prediction": "Predicting runs without success (the outcome is not 1) in scenes that the model was not fitted on; "
    "auc_low, auc_high: 95 % for scenes at large.",
    "prediction_coefficients": "That model, fitted to all scenes: above 0, more of the feature goes with failure.",
    "predictions": "The predicted probability of no success on each sequence, by the model without its scene.",
    "images": "What the images of each setting are like, over its sequences; frames are sampled.",
    "depth": "What the depth of each setting is like, over its sequences; frames are sampled.",
    "motion": "How fast the camera moves and turns in each setting, from the true poses.",
}
"""One line for each table of analyse, in the order in which they are shown."""


def analyse(runs: "DataFrame", sequences: "DataFrame") -> dict[str, "DataFrame"]:
    """Return every table of CAPTIONS from the tables of runs and of sequences (tables/runs.csv, tables/sequences.csv).

    The same tables give the same results, whatever their rows' order. Cells without a value are NaN; a table that
    nothing can be said in has columns and no rows. Raises MissingDependencyError without the extra evaluate.
    """
    need(["scipy", "pandas"], "evaluate")
    table, about = tidy_runs(runs), tidy_sequences(sequences)
    headline, measures = headline_of(table), measures_of(table)
    folds, coefficients, predicted = prediction_tables(table, about)
    found = {
        "over_clean": over_clean_table(table, ["system", *SETTING]),
        "spread": spread_table(table, measures),
        "variance": variance_table(table),
        "differences": difference_table(table, measures),
        "tests": against_clean_table(table, headline),
        "curves": curve_table(table, headline),
        "systems": grouped_table(table, headline, []),
        "by_perturbation": grouped_table(table, headline, ["perturbation"]),
        "by_mode": grouped_table(table, headline, ["mode"]),
        "by_severity": grouped_table(table, headline, ["severity"]),
        "robustness": robustness_table(table),
        "perturbation_correlations": perturbation_correlations(table),
        "system_correlations": system_correlations(table),
        "indicator_correlations": indicator_correlations(table, about),
        "prediction": folds,
        "prediction_coefficients": coefficients,
        "predictions": predicted,
        **sequences_tables(about),
    }
    return {name: found[name] for name in CAPTIONS}
