# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers in the prose of docs/results.md are those of the records: each interval, and the counts beside them."""

import re

import numpy as np
import pytest

pytest.importorskip("pandas", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from results_page import D435, NUMBER, PAGE, PAIR, RECORD, agrees, read, verdicts
from scipy.stats import f as f_distribution

ORB = "orb_slam3"
DEPTH, COLOUR = "depth_gaussian_noise_s3", "gaussian_noise_s3"
WAYS = "rgbd_odometry", "rgbd_odometry_depth", "rgbd_odometry_colour"
LIKE = COLOUR, "motion_blur_s3", "spatter_s3"
MEASURED = rf"({NUMBER}(?: mm| %)?(?: \[{NUMBER}, {NUMBER}\])?)"
INTERVAL = re.compile(rf"{NUMBER}(?: mm| %)? \[{NUMBER}, {NUMBER}\]")
TEXT = " ".join("\n".join(line for line in PAGE.splitlines() if not re.match(r"\| `[^`]+` \|", line)).split())
"""The page as one line, without the rows whose cells test_results_page.py holds."""
HELD_ELSEWHERE = re.compile(
    r"Spearman's correlation of their log ratios is [^]]+\]|\*\*[^*]+\*\* times that of perfect depth"
)


def ratio(setting, system=ORB, record="six"):
    return "ratio", system, setting, record


def p_of(setting, system=ORB):
    return "p", system, setting


def mean(setting, measure="ate_rmse_m", factor=1e3, system=ORB, record="six"):
    return "mean", system, setting, measure, factor, record


def extreme(which, setting, column="ate_rmse_m", factor=1e3, **where):
    return "extreme", which, setting, column, factor, where


def tracked(which, setting, **where):
    """The least or the largest share of the frames, in per cent, of the runs that are incomplete."""
    return extreme(which, setting, "tracked_share", 100.0, result="incomplete", **where)


def clean_row(name, system):
    scales = (extreme(which, "clean", "scale", 1.0, system=system) for which in ("min", "max"))
    return (
        f"| {name} | {{}} | {{}} | {{}} to {{}} |",
        mean("clean", system=system),
        extreme("max", "clean", system=system),
        *scales,
    )


def by_paper(setting):
    return mean(setting, "paper.ate_m", 1.0)


# What is said, with {} for each number, alone or with its interval, and what each of them is.
CLAIMS = [
    clean_row("ORB-SLAM3, 18 runs", ORB),
    clean_row("ORB-SLAM2, 18", "orb_slam2"),
    *(
        clean_row(f"`{system}`, 6", system)
        for system in ("rgbd_odometry", "rgbd_odometry_depth", "rgbd_odometry_colour")
    ),
    clean_row("KISS-ICP, 6", "kiss_icp"),
    ("a run of ORB-SLAM3 on them varies by a factor of {},", ("factor", "repeat", ORB, "clean")),
    ("differ by a factor of {} at most in any room", ("rooms apart",)),
    ("slides by {} in room 4", extreme("max", "clean", system="kiss_icp")),
    ("depth 5 frames late, {} times the clean error (p {})", ratio("desync_5"), p_of("desync_5")),
    ("noise on depth, {} (p {}), and impulse", ratio(DEPTH), p_of(DEPTH)),
    ("impulse noise on colour, {} (p {})", ratio("impulse_noise_s3"), p_of("impulse_noise_s3")),
    ("Worse: motion blur, {} (p {})", ratio("motion_blur_s3"), p_of("motion_blur_s3")),
    ("Gaussian noise on colour, {} (p {}), spatter", ratio(COLOUR), p_of(COLOUR)),
    ("spatter, {} (p {})", ratio("spatter_s3"), p_of("spatter_s3")),
    ("a sensor's noise of 1 cm, {} (p {})", ratio("clean_sensor"), p_of("clean_sensor")),
    ("and Gaussian blur, {} (p {})", ratio("gaussian_blur_s3"), p_of("gaussian_blur_s3")),
    ("driven four times as fast, {}", ratio("speed_x4")),
    ("depth clipped in range, {}", ratio("depth_range_clipping_s3")),
    ("missing depth, {},", ratio("depth_random_missing_s3")),
    ("a shaken path, {}", ratio("deviation_3deg_0.025m")),
    ("the paper's fog, {}", ratio("fog_s3")),
    (
        "the study cannot tell: {}, {} (p {}) and {} (p {})",
        ratio("contrast_s3"),
        *(value(setting) for setting in ("jpeg_compression_s3", "pixelate_s3") for value in (ratio, p_of)),
    ),
    (
        "are incomplete, with {} to {} of the frames tracked; none is",
        *(tracked(which, "frost_s3") for which in ("min", "max")),
    ),
    ("noise does: {} instead of {}, {} times (p {})", mean(DEPTH), mean("clean"), ratio(DEPTH), p_of(DEPTH)),
    ("on clean frames {} of the variance", ("share", ORB)),
    ("of ORB-SLAM2's {} (table", ("share", "orb_slam2")),
    (
        "changes an error by a factor of {} and {}, another room by {} and {}",
        *(("factor", level, system, "clean") for level in ("repeat", "scene") for system in PAIR),
    ),
    ("AUC {} over six folds", ("auc", ORB)),
    ("ORB-SLAM2, which had fewer settings: {}, 35 of 66 |", ("auc", "orb_slam2")),
    (
        "no: {} times the error, {}, which is worse (p {})",
        ratio("clean_sensor"),
        mean("clean_sensor"),
        p_of("clean_sensor"),
    ),
    ("perfect depth (p 0.0047), {} at most, with scales of", extreme("max", "clean", record="d435")),
    (
        "with scales of {} to {}:",
        *(extreme(which, "clean", "scale", 1.0, record="d435") for which in ("min", "max")),
    ),
    ("noise of 1 cm ({})", ratio("clean_sensor")),
    ("worse over the D435 (p {} at most,", ("largest p",)),
    (
        "twice as bad: {} times in place of {}, as the clean error is larger and the late one smaller, "
        "{} in place of {}.",
        ratio("desync_5", record="d435"),
        ratio("desync_5"),
        mean("desync_5", record="d435"),
        mean("desync_5"),
    ),
    (
        "leaves {} as with perfect depth, which is {} times the D435's own error in place of {},",
        mean(DEPTH, record="d435"),
        ratio(DEPTH, record="d435"),
        ratio(DEPTH),
    ),
    (
        "have like ratios, {} in place of {}, {} in place of {} and {} in place of {}, of larger errors: "
        "{} in place of {}, {} in place of {} and {} in place of {}.",
        *(ratio(setting, record=record) for setting in LIKE for record in ("d435", "six")),
        *(mean(setting, record=record) for setting in LIKE for record in ("d435", "six")),
    ),
    (
        "over the D435 too 4 of 6 rooms are incomplete, with {} to {} of the frames",
        *(tracked(which, "frost_s3", record="d435") for which in ("min", "max")),
    ),
    (
        "makes depth alone fail (4 of 6 rooms are incomplete, with {} to {} of the frames",
        *(tracked(which, DEPTH, system="rgbd_odometry_depth") for which in ("min", "max")),
    ),
    (
        "bear it at {}, and motion blur at {}, which are large ratios to a clean error of {}.",
        *(mean(setting, system=WAYS[0]) for setting in (DEPTH, "motion_blur_s3", "clean")),
    ),
    (
        "With noise on colour they err by {} and with missing depth by {}:",
        *(mean(setting, system=WAYS[0]) for setting in (COLOUR, "depth_random_missing_s3")),
    ),
    (
        "by colour alone worse, {} times (p {}) and {} (p {}),",
        *(value(setting, WAYS[2]) for setting in (COLOUR, "motion_blur_s3") for value in (ratio, p_of)),
    ),
    ("of colour alone the study cannot tell, {} (p {})", ratio(DEPTH, WAYS[2]), p_of(DEPTH, WAYS[2])),
    (
        "makes depth alone worse, {} times (p {}), and of colour alone the study cannot tell either, {}.",
        ratio("clean_sensor", WAYS[1]),
        p_of("clean_sensor", WAYS[1]),
        ratio("clean_sensor", WAYS[2]),
    ),
    (
        "noise of 1 cm costs depth alone most, {}, and both together {}; that colour alone, at {}, is",
        *(mean("clean_sensor", system=system) for system in (WAYS[1], WAYS[0], WAYS[2])),
    ),
    ("the path driven four times as fast, of which the study cannot tell, {}:", ratio("speed_x4", "kiss_icp")),
    (
        "worse with noise on depth, {} times (p {}) and with motion blur, {} (p {}).",
        *(value(setting, WAYS[0]) for setting in (DEPTH, "motion_blur_s3") for value in (ratio, p_of)),
    ),
    (
        "the scale that would fit best is {} at severity 3 (table `spread`, measure `scale`), "
        "and {} with a sensor's noise, {} clean",
        *(mean(setting, "scale", 1.0) for setting in (DEPTH, "clean_sensor", "clean")),
    ),
    (
        "over a second the error is {} instead of {} (measure",
        *(mean(name, "rpe_1s_rmse_m") for name in (DEPTH, "clean")),
    ),
    (
        "the estimated path is {} longer than the true one (`path_share`; clean {})",
        ("longer", DEPTH),
        ("longer", "clean"),
    ),
    ("shakes as much, {}, and leaves the scale at {}.", ("longer", COLOUR), mean(COLOUR, "scale", 1.0)),
    ("are said to be tracked err by {} to", extreme("min", "frost_s3")),
    ("the scale that would fit is {} in one room", extreme("min", "frost_s3", "scale", 1.0)),
    ("gives the same runs {}.", mean("frost_s3", "paper.ate_m")),
    ("late depth in one room: 116 and {})", extreme("max", "desync_5")),
    ("path longest: it is {} longer than the true one (`path_share`), and", ("longer", "motion_blur_s3")),
    (
        "over a second the error is {} (`rpe_1s_rmse_m`; late depth has {}), with the scale at {}.",
        mean("motion_blur_s3", "rpe_1s_rmse_m"),
        mean("desync_5", "rpe_1s_rmse_m"),
        mean("motion_blur_s3", "scale", 1.0),
    ),
    (
        "its error differs by a factor of {} (table `variance`), the clean one by {}.",
        *(("factor", "scene", ORB, name) for name in ("impulse_noise_s3", "clean")),
    ),
    ("| clean | {} |", by_paper("clean")),
    ("| noise on depth, severity 3 | {} |", by_paper(DEPTH)),
    ("| depth 5 frames late | {} |", by_paper("desync_5")),
    ("| Gaussian noise on colour, severity 3 | {} |", by_paper(COLOUR)),
    ("| frost, severity 3 | {} |", by_paper("frost_s3")),
    ("has {} here by a protocol in which", mean("frost_s3", "paper.ate_m")),
    ("does: {} here, {} by `strict`", mean(DEPTH, "paper.ate_m"), mean(DEPTH)),
    ("a run's own chance (a factor of {} on clean frames)", ("factor", "repeat", ORB, "clean")),
]


class Records:
    """What the claims are looked up in."""

    def __init__(self):
        self.read = {"six": read(RECORD), "d435": read(D435)}
        self.verdicts = {}

    def table(self, name, record="six"):
        return self.read[record][1][name]

    def of(self, kind, *rest):
        """The value of a claim, alone or with the ends of its interval."""
        return getattr(self, kind.replace(" ", "_"))(*rest)

    def ratio(self, system, setting, record):
        row = self._measured("differences", record).loc[system, setting, "ate_rmse_m"]
        return [row["ratio"], row["ratio_low"], row["ratio_high"]]

    def p(self, system, setting):
        if system not in self.verdicts:
            self.verdicts[system] = verdicts(self.read["six"][0], system)
        return [self.verdicts[system][setting][1]["p_holm"]]

    def mean(self, system, setting, measure, factor, record):
        return [*factor * self._measured("spread", record).loc[system, setting, measure][["mean", "low", "high"]]]

    def longer(self, setting):
        return [100.0 * (value - 1.0) for value in self.mean(ORB, setting, "path_share", 1.0, "six")]

    def extreme(self, which, setting, column, factor, where):
        cell = self.read[where.get("record", "six")][0].query("setting == @setting")
        for name, value in {"system": where.get("system", ORB), "result": where.get("result")}.items():
            cell = cell if value is None else cell[cell[name] == value]
        return [factor * getattr(cell[column], which)()]

    def factor(self, level, system, setting):
        return [self._measured("variance").loc[system, setting, "ate_rmse_m"][f"{level}_factor"]]

    def share(self, system):
        """The share of the variance of log ATE between repeats, with its exact interval for balanced normal data."""
        runs = self.read["six"][0]
        clean = runs[(runs["system"] == system) & (runs["setting"] == "clean")]
        logs = np.log(clean.pivot(index="scene", columns="repeat", values="ate_rmse_m").to_numpy())
        rooms, repeats = logs.shape
        freedom = rooms - 1, rooms * (repeats - 1)
        quotient = repeats * logs.mean(axis=1).var(ddof=1) / logs.var(axis=1, ddof=1).mean()
        ends = quotient / f_distribution.ppf([0.025, 0.975], *freedom)
        return [repeats / (value + repeats - 1.0) for value in (quotient, *ends)]

    def largest_p(self):
        """The largest p of the settings that are worse over the D435."""
        found = verdicts(self.read["d435"][0])
        return [max(row["p_holm"] for said, row in found.values() if said == "worse")]

    def auc(self, system):
        table = self.table("prediction")
        row = table[
            (table["system"] == system) & (table["outcome"] == "success_2x_clean") & (table["held_out"] == "all")
        ]
        return [*row[["auc", "auc_low", "auc_high"]].iloc[0]]

    def rooms_apart(self):
        runs = self.read["six"][0].query("setting == 'clean'")
        rooms = runs.groupby(["system", "scene"])["ate_rmse_m"].mean()
        return [np.exp(np.abs(np.log(rooms[PAIR[0]] / rooms[PAIR[1]])).max())]

    def _measured(self, name, record="six"):
        return self.table(name, record).set_index(["system", "setting", "measure"])


NAMES = {
    "desync_5": "depth 5 frames late",
    DEPTH: "noise on depth",
    "impulse_noise_s3": "impulse noise on colour",
    "motion_blur_s3": "motion blur",
    COLOUR: "Gaussian noise on colour",
    "spatter_s3": "spatter",
    "clean_sensor": "a sensor's noise of 1 cm",
    "gaussian_blur_s3": "Gaussian blur",
    "frost_s3": "Frost has a ratio in two rooms, so none is concluded",
    "speed_x4": "a path driven four times as fast",
    "depth_range_clipping_s3": "depth clipped in range",
    "depth_random_missing_s3": "missing depth",
    "deviation_3deg_0.025m": "a shaken path",
    "fog_s3": "the paper's fog",
    "contrast_s3": "contrast",
    "jpeg_compression_s3": "JPEG",
    "pixelate_s3": "pixelation",
}


@pytest.fixture(scope="module")
def records():
    return Records()


def found(snippet):
    """The one place in the text where a claim's snippet stands."""
    places = list(re.finditer(re.escape(snippet).replace(r"\{\}", MEASURED), TEXT))
    assert len(places) == 1, (snippet, len(places))
    return places[0]


@pytest.mark.parametrize(("snippet", "specs"), [(claim[0], claim[1:]) for claim in CLAIMS], ids=[c[0] for c in CLAIMS])
def test_a_number_in_prose_is_that_of_the_record(records, snippet, specs):
    texts = found(snippet).groups()
    for text, spec in zip(texts, specs, strict=True):
        values = records.of(*spec)
        assert agrees(text, *(values if "[" in text else values[:1])), (text, spec, values)


def test_each_interval_in_prose_is_held():
    held = [found(snippet).span() for snippet, *_ in CLAIMS]
    held += [place.span() for place in HELD_ELSEWHERE.finditer(TEXT)]
    loose = [
        TEXT[max(0, place.start() - 60) : place.end()]
        for place in INTERVAL.finditer(TEXT)
        if not any(start <= place.start() and place.end() <= end for start, end in held)
    ]
    assert loose == []


def test_each_setting_stands_where_its_verdict_puts_it(records):
    """Questions 1 and 2 name every setting once: twice as bad, worse, as it was, or that the study cannot tell."""
    answers = {number: re.search(rf"\| {number} \|[^|]*\|([^|]*)\|", TEXT)[1] for number in (1, 2)}
    twice, worse = answers[1].split("Worse: ")
    as_it_was, cannot_tell = answers[2].split(". Of ")
    wanted = dict.fromkeys(NAMES, "")
    for setting, (said, row) in verdicts(records.read["six"][0]).items():
        wanted[setting] = "twice" if said == "worse" and row["ratio_low"] > 2.0 else said
    texts = {"twice": twice, "worse": worse, "none": worse, "as it was": as_it_was, "cannot tell": cannot_tell}
    for setting, name in NAMES.items():
        assert [said for said in ("twice", "worse", "as it was", "cannot tell") if name in texts[said]] == [
            "worse" if wanted[setting] == "none" else wanted[setting]
        ], setting


def test_counts_in_prose_are_those_of_the_record(records):
    runs = records.read["six"][0]
    predictions = records.table("prediction")
    pooled = predictions[(predictions["system"] == ORB) & (predictions["held_out"] == "all")].set_index("outcome")
    of_ratio = pooled.loc["success_2x_clean"]
    assert f"{of_ratio['n_without_success']:.0f} of {of_ratio['n']:.0f} rooms times settings" in TEXT
    rest = runs[(runs["system"] == ORB) & (runs["setting"] != "frost_s3")]
    least = re.search(r"Without frost every run of ORB-SLAM3 tracked (\d+) % of the frames or more", TEXT)[1]
    assert int(100.0 * rest["tracked_share"].min()) == int(least)
    late = rest[rest["ate_rmse_m"] > 0.1].sort_values("ate_rmse_m")
    assert set(late["setting"]) == {"desync_5"}
    assert late["scene"].nunique() == 1
    assert agrees("116 and 119", *1e3 * late["ate_rmse_m"])
    of_2 = predictions[(predictions["system"] == PAIR[1]) & (predictions["outcome"] == "success_2x_clean")]
    of_2 = of_2[of_2["held_out"] == "all"].iloc[0]
    assert [of_2["n_without_success"], of_2["n"]] == [35, 66]
    paths = records.table("spread").query("measure == 'path_share' and system == @ORB").set_index("setting")["mean"]
    assert paths.idxmax() == "motion_blur_s3"
    clean_mm = records.mean(ORB, "clean", "paper.ate_m", 1.0, "six")[0]
    assert f"The paper's error is {0.082 / clean_mm:.0f} times ours on clean frames" in TEXT
    assert 0.80 / records.mean(ORB, DEPTH, "paper.ate_m", 1.0, "six")[0] > 100.0


def test_what_was_run_twice_is_named(records):
    runs = records.read["six"][0]
    repeats = runs[(runs["system"] == ORB) & (runs["setting"] != "clean")].groupby(["setting", "scene"]).size()
    twice = repeats.groupby("setting").min()
    names = NAMES | {"desync_5": "late depth", "clean_sensor": "a sensor's noise"}
    text = re.search(r"clean frames three times, (.+?) twice and the others once", TEXT)[1]
    assert sorted(re.split(", | and ", text)) == sorted(names[setting] for setting in twice.index[twice == 2])
    assert twice.max() == 2
