# SPDX-License-Identifier: GPL-3.0-or-later
"""What a report begins with: what broke each system and by how much, from tables whose answers are known."""

import pytest
from results_made import write_runs

pytest.importorskip("jinja2", reason="the extra evaluate is not installed")
pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from noisy_world.evaluate.analyses import analyse
from noisy_world.evaluate.figures import numbered_decades
from noisy_world.evaluate.findings import findings_of, headline_table, ranking_picture, sentences
from noisy_world.evaluate.report_sections import curves_of, opening, table_of, with_interval
from noisy_world.evaluate.report_tables import markdown_table, read_results
from noisy_world.evaluate.study_tables import SETTING, over_clean_table, tidy_runs

FAILED = ("", "", "crashed", "no_poses")
NOTHING_TOLD = ", so nothing tells what noise did: its largest ATE is"
CLEAN = {"clean": (0.0005, 1.0)}


def results_of(folder, systems, scenes=("a", "b")):
    """Return results. systems: settings by name, each an ATE in metres and a tracked share, or FAILED, in all scenes.

    A setting may name its scene: a/fog.
    """
    rows = []
    for system, settings in systems.items():
        for scene in scenes:
            for name, (ate_m, tracked, *word) in settings.items():
                wanted, setting = name.split("/") if "/" in name else (scene, name)
                if wanted != scene:
                    continue
                perturbation, _, severity = setting.partition("_s")
                row = {"scene": scene, "setting": setting, "perturbation": perturbation, "mode": "static"}
                row |= {"severity": severity, "seed": 1, "system": system, "repeat": 1, "frames": 50}
                row |= dict(zip(("outcome", "failure"), word or ("finished", ""), strict=True))
                lost = 0.0 if word or tracked < 0.8 else 1.0
                row |= {"ate_rmse_m": ate_m, "tracked_share": tracked or 0.0}
                row |= {"success_10cm": lost * float(not word and ate_m < 0.1)}
                rows.append(row | {"success_auc": lost * (1.0 - (0.0 if word else ate_m))})
    write_runs(folder, rows)
    return read_results(folder)


def said_of(folder, systems, *, all_tables=False, **scenes):
    """Return the sentences, and what they were made from. all_tables: those of all analyses, which take a second."""
    results = results_of(folder, systems, **scenes)
    analyses = {"over_clean": over_clean_table(tidy_runs(results.runs), ["system", *SETTING])}
    if all_tables:
        analyses = analyse(results.runs, results.sequences)
    found = findings_of(results, analyses["over_clean"])
    return [text.replace("\u00a0", " ") for text in sentences(found)], results, analyses, found


def test_the_worst_is_said_with_its_ratio_and_both_errors(tmp_path):
    settings = CLEAN | {"fog_s1": (0.0006, 1.0), "desync": (0.037, 1.0), "motion_blur_s5": (0.026, 1.0)}
    said, results, analyses, found = said_of(tmp_path, {"mine": settings}, all_tables=True)
    assert said == ["Worst for mine: desync, \u00d7 74 its error on clean frames (37 mm instead of 0.5 mm)."]
    assert [ranked.setting for ranked in found[0].settings] == ["desync", "motion_blur_s5", "fog_s1"]
    # Below 10 cm all of them are successes; beside clean, two of three settings are none.
    text = opening(results)
    assert "8 had success at 10 cm" in text
    assert "Of the 6 perturbed runs that have a clean one beside them, 2 had success at 10 \u00d7 clean" in text
    pictures, sentences_ = curves_of(analyses)
    assert pictures == []  # two points make no curve
    assert sentences_ == ["fog, motion_blur have one severity, which makes no curve: see Settings."]
    settings |= {"fog_s3": (0.026, 1.0)}
    pictures, sentences_ = curves_of(said_of(tmp_path / "more", {"mine": settings}, all_tables=True)[2])
    assert [picture.name for picture in pictures] == ["over_clean_curves", "failure_over_clean_curves"]
    assert sentences_[0] == "motion_blur has one severity, which makes no curve: see Settings."
    assert "Every run had success at 10 cm at every severity" in sentences_[1]
    assert "Success AUC is between 0.974 and 1" in sentences_[2]


def test_a_failure_ranks_first_and_is_no_ratio(tmp_path):
    settings = CLEAN | {"frost": FAILED, "desync": (0.05, 1.0), "a/fog": FAILED, "b/fog": (0.001, 1.0)}
    said, _, _, found = said_of(tmp_path, {"mine": settings})
    assert said == [
        "Worst for mine: frost, where it failed in 2 of 2 runs; of the others, desync, \u00d7 100 its error on clean "
        "frames (50 mm instead of 0.5 mm)."
    ]
    assert [(ranked.setting, ranked.broke, ranked.endings) for ranked in found[0].settings] == [
        ("frost", True, "failed 2 of 2"),
        ("fog", True, "failed 1 of 2"),
        ("desync", False, ""),
    ]
    assert ranking_picture(found) is not None


def test_a_run_that_gives_up_early_is_no_small_error(tmp_path):
    settings = CLEAN | {"frost": (0.0001, 0.3), "desync": (0.002, 1.0)}
    said, _, _, _ = said_of(tmp_path, {"mine": settings})
    assert said[0].startswith(
        "Worst for mine: frost, where it was incomplete in 2 of 2 runs; of the others, desync, \u00d7 4"
    )


def test_fewer_failures_than_half_are_said_beside_the_ratio(tmp_path):
    settings = CLEAN | {"a/fog": FAILED, "b/fog": (0.01, 1.0), "c/fog": (0.01, 1.0)}
    said, _, _, _ = said_of(tmp_path, {"mine": settings}, scenes=("a", "b", "c"))
    assert said[0].endswith("(10 mm instead of 0.5 mm); it failed in 1 of 3 runs, which no ratio counts.")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (CLEAN, ["clean frames alone", "0.5 mm"]),
        ({"fog": (0.02, 1.0)}, ["not run on clean", NOTHING_TOLD, "20 mm, fog"]),
        ({"clean": FAILED, "fog": (2.0, 1.0)}, ["in 2 of 2 runs", NOTHING_TOLD, "2 m, fog"]),
        ({"clean": FAILED, "fog": FAILED}, ["in 2 of 2 runs", "no other run is complete"]),
        ({"clean": (0.001, 0.4), "fog": (0.02, 1.0)}, ["incomplete on clean", NOTHING_TOLD, "20 mm, fog"]),
        (CLEAN | {"fog": (0.0004, 1.0)}, ["Nothing made mine worse", "fog, \u00d7 0.8", "0.4 mm instead of 0.5 mm"]),
    ],
    ids=["clean alone", "no clean", "clean failed", "all failed", "clean lost", "better"],
)
def test_what_cannot_be_compared_is_said(tmp_path, settings, words):
    (said,), _, _, found = said_of(tmp_path, {"mine": settings})
    assert all(word in said for word in words), said
    if "clean" not in settings or not found[0].compared:
        assert ranking_picture(found) is None


def test_the_system_that_broke_most_is_the_first(tmp_path):
    systems = {"careful": CLEAN | {"fog": (0.01, 1.0)}, "plain": {"clean": (0.002, 1.0), "fog": (0.2, 1.0)}}
    said, results, analyses, found = said_of(tmp_path, systems, all_tables=True)
    assert [text.split(":")[0] for text in said] == ["Worst for plain", "Worst for careful"]
    table = headline_table(results, analyses, found)
    assert [row["worst"].replace("\u00a0", " ") for row in table.frame.to_dict("records")] == [
        "fog, \u00d7 20",
        "fog, \u00d7 100",
    ]


def test_a_system_is_not_compared_with_itself(tmp_path):
    one = {"mine": CLEAN | {"fog": (0.01, 1.0)}}
    _, results, analyses, found = said_of(tmp_path / "one", one, all_tables=True)
    assert "mce" not in {column.name for column in headline_table(results, analyses, found).columns}
    assert {"mce", "baseline"}.isdisjoint(
        column.name for column in table_of("robustness", analyses["robustness"]).columns
    )
    _, results, analyses, found = said_of(
        tmp_path / "two", one | {"rgbd_odometry": CLEAN | {"fog": (0.02, 1.0)}}, all_tables=True
    )
    table = headline_table(results, analyses, found)
    assert "mCE is against rgbd_odometry" in table.caption
    mce = {row["system"]: row["mce"] for row in table.frame.to_dict("records")}
    assert mce["mine"] == pytest.approx(0.5)
    assert mce["rgbd_odometry"] != mce["rgbd_odometry"]  # NaN


def test_intervals_are_shown_from_five_on(tmp_path):
    assert with_interval(0.5, 0.4, 0.6, 4) == "0.5"
    assert with_interval(0.5, 0.4, 0.6, 5) == "0.5 [0.4, 0.6]"
    scenes = "abcde"
    settings = {
        f"{scene}/{name}": (ate_m * (k + 1), 1.0)
        for k, scene in enumerate(scenes)
        for name, ate_m in (("clean", 0.001), ("fog_s1", 0.005), ("fog_s3", 0.01))
    }
    for count, shown in ((4, False), (5, True)):
        few = {name: value for name, value in settings.items() if name[0] in scenes[:count]}
        _, _, analyses, _ = said_of(tmp_path / str(count), {"mine": few}, all_tables=True, scenes=tuple(scenes[:count]))
        assert ("[-0." in markdown_table(table_of("differences", analyses["differences"]), 40)) is shown
        assert analyses["differences"]["low"].notna().any()  # the file has them
        assert any("Dotted lines" in picture.about for picture in curves_of(analyses)[0]) is shown


@pytest.mark.parametrize(
    ("low", "high", "numbered"),
    [
        (0.8, 60.0, [1.0, 10.0]),
        (0.5, 5e3, [1.0, 10.0, 100.0, 1e3]),
        (0.2, 1.3e5, [1.0, 100.0, 1e4]),
        (0.002, 200.0, [0.01, 1.0, 100.0]),
    ],
)
def test_a_long_scale_is_numbered_at_every_second_power_of_ten(low, high, numbered):
    assert numbered_decades(low, high) == pytest.approx(numbered)
