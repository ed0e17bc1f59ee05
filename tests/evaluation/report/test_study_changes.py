# SPDX-License-Identifier: GPL-3.0-or-later
"""Two studies beside each other: which findings change, by ratios whose answers are known."""

from dataclasses import replace

import numpy as np
import pytest
from results_made import write_runs

pytest.importorskip("jinja2", reason="the extra evaluate is not installed")
pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")
stats = pytest.importorskip("scipy.stats", reason="the extra evaluate is not installed")

from noisy_world.cli import command
from noisy_world.evaluate.report_tables import read_results
from noisy_world.evaluate.study_changes import changes_section

CLEAN_M = 0.01


def study(folder, errors, scenes="abcdef", seeds=(1,)):
    """A results folder. errors: by system and setting the error over clean, a function of scene's number and seed's;
    None for a run that failed."""
    rows = []
    for system, settings in errors.items():
        for place, scene in enumerate(scenes):
            for setting, over in ({"clean": lambda *_: 1.0} | settings).items():
                for seed in seeds:
                    times = over(place, seed)
                    row = {
                        "scene": scene,
                        "setting": setting,
                        "perturbation": setting,
                        "mode": "static",
                        "severity": "",
                    }
                    row |= {"seed": seed, "system": system, "repeat": 1, "frames": 50, "tracked_share": 1.0}
                    row |= {"outcome": "finished", "failure": "", "ate_rmse_m": CLEAN_M * (times or 1)}
                    if times is None:
                        row |= {"outcome": "crashed", "failure": "no_poses", "ate_rmse_m": "", "tracked_share": 0.0}
                    rows.append(
                        row | {"success_10cm": float(times is not None), "success_auc": float(times is not None)}
                    )
    write_runs(folder, rows)
    return read_results(folder)


def test_a_change_is_the_paired_ratio_over_scenes_with_its_interval(tmp_path):
    logs = np.array([0.6, 0.7, 0.8, 0.65, 0.75, 0.7])
    own = np.array([1.0, 2.0, 4.0, 1.5, 3.0, 2.5])  # of scenes, which both studies share
    before = study(tmp_path / "before", {"mine": {"fog": lambda k, _: own[k], "jpeg": lambda k, _: 2.0 + own[k] / 50}})
    now = study(
        tmp_path / "now",
        {"mine": {"fog": lambda k, _: own[k] * np.exp(logs[k]), "jpeg": lambda k, _: 2.0 + own[5 - k] / 50}},
    )
    section = changes_section(now, before)
    (table,) = section.tables
    fog, jpeg = table.frame.to_dict("records")
    assert (fog["setting"], fog["finding"], jpeg["finding"]) == ("fog", "worse", "")
    half = stats.t.ppf(0.975, 5) * logs.std(ddof=1) / 6**0.5
    assert fog["ratio"] == pytest.approx(np.exp(logs.mean()))
    assert [fog["ratio_low"], fog["ratio_high"]] == pytest.approx(np.exp([logs.mean() - half, logs.mean() + half]))
    assert section.paragraphs[0].startswith("1 of the 2 findings that both have changes.")
    (back,) = [
        row for row in changes_section(before, now).tables[0].frame.to_dict("records") if row["setting"] == "fog"
    ]
    assert back["finding"] == "better"
    assert back["ratio"] == pytest.approx(1 / fog["ratio"])


def test_in_few_scenes_other_seeds_tell(tmp_path):
    jitter = {1: -0.02, 2: 0.0, 3: 0.02}
    one = study(tmp_path / "one", {"mine": {"fog": lambda _, seed: 2 * np.exp(jitter[seed])}}, "ab", (1, 2, 3))
    two = study(tmp_path / "two", {"mine": {"fog": lambda _, seed: np.exp(jitter[seed])}}, "ab", (1, 2, 3))
    (row,) = changes_section(two, one).tables[0].frame.to_dict("records")
    assert row["finding"] == "better"
    # Each of four means, two scenes in two studies, has a variance of .02^2 / 3, of 2 degrees of freedom.
    half = stats.t.ppf(0.975, 8) * (4 * 0.02**2 / 3 / 4) ** 0.5
    assert [row["here_low"], row["here_high"]] == pytest.approx([0.5 * np.exp(-half), 0.5 * np.exp(half)])
    assert "in these scenes" in " ".join(changes_section(two, one).paragraphs)


def test_what_breaks_and_what_one_study_lacks_is_said(tmp_path):
    flat = {"fog": lambda *_: 3.0, "jpeg": lambda *_: 2.0, "rain": lambda *_: 2.0}
    before = study(tmp_path / "before", {"mine": flat | {"frost": lambda *_: None}, "old": flat}, "ab")
    now = study(tmp_path / "now", {"mine": flat | {"fog": lambda *_: None, "frost": lambda *_: 1.5}}, "ab")
    said = changes_section(now, before).paragraphs
    assert "fog with mine breaks now: failed 2 of 2, before complete." in said
    assert "frost with mine no longer breaks: complete, before failed 2 of 2." in said
    assert "Worst for mine was frost, and is fog." in said
    assert "Only before: old." in said
    several = study(tmp_path / "several", {"mine": {f"s{k}": lambda *_: None for k in range(9)}}, "a")
    fewer = study(tmp_path / "fewer", {"mine": {f"s{k}": lambda *_: 2.0 for k in range(8)}}, "a")
    said = changes_section(several, fewer).paragraphs
    assert "2 more: see the table." in said
    assert "Only now, of mine: s8." in said
    other = study(tmp_path / "other", {"theirs": flat}, "a")
    nothing = changes_section(other, now)
    assert nothing.paragraphs[0] == "The two studies have no system and setting in common."
    assert not nothing.tables


def test_the_report_of_one_study_beside_another(tmp_path, capsys):
    before = study(tmp_path / "before", {"mine": {"fog": lambda *_: 3.0}}, "ab")
    now = study(tmp_path / "now", {"mine": {"fog": lambda *_: None}}, "ab")
    told = [{"protocol": protocol, "systems": {"mine": {"version": protocol}}} for protocol in ("strict", "paper")]
    said = changes_section(replace(now, study=told[1]), replace(before, study=told[0])).paragraphs
    assert "Protocols differ, strict and paper, so errors are not of one kind." in said
    assert "Definitions differ of mine." in said
    (tmp_path / "now/study.json").unlink()  # else tables are made anew, of runs that are not there
    assert command.main(["report", str(tmp_path / "now"), "--against", str(tmp_path / "before")]) == 0
    assert "fog with mine breaks now" in capsys.readouterr().out
    page = (tmp_path / "now/report.html").read_text()
    assert "Beside before" in page
    assert "fog with mine breaks now" in page
    assert (tmp_path / "now/tables/changes.csv").read_text().startswith("system,setting,finding")


@pytest.mark.parametrize(
    ("words", "said"), [(("a", "b"), "--against"), (("a", "--against", "b", "--tables"), "which --tables leaves out")]
)
def test_options_that_contradict_each_other_are_refused(capsys, words, said):
    with pytest.raises(SystemExit):
        command.main(["report", *words])
    assert said in capsys.readouterr().err
