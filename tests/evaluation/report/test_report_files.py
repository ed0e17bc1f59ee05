# SPDX-License-Identifier: GPL-3.0-or-later
"""The report as a whole: what is in it, that it is the same twice, what it does with folders that lack something."""

import csv
import html.parser
import json
import re
import shutil

import pytest
from refusals import refused
from results_made import SETTINGS, SMALL, make_results, without_analyses, without_pictures

pytest.importorskip("jinja2", reason="the extra evaluate is not installed")
pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from noisy_world.cli import command
from noisy_world.core.errors import StorageError
from noisy_world.evaluate.analyses import analyse
from noisy_world.evaluate.findings import settings_table
from noisy_world.evaluate.report import write_report
from noisy_world.evaluate.report_tables import read_results
from noisy_world.evaluate.study_results import ResultsFolder as StudyResults
from noisy_world.evaluate.study_tables import write_tables
from noisy_world.evaluate.thresholds import FORMAT, KIND, threshold_text


class Page(html.parser.HTMLParser):
    """What a browser would fetch, and how elements nest."""

    VOID = {"meta", "img", "br", "link", "input", "source"}

    def __init__(self, text):
        super().__init__()
        self.fetched, self.open, self.anchors, self.ids, self.images = [], [], [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.fetched += [values[name] for name in ("src", "srcset", "href", "data", "poster") if name in values]
        self.ids += [values["id"]] if "id" in values else []
        self.images += tag == "img"
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A results folder with its report."""
    folder = make_results(tmp_path_factory.mktemp("results"), **SMALL)
    return folder, write_report(folder)


@pytest.fixture
def quick(monkeypatch):
    without_analyses(monkeypatch)


@pytest.fixture
def bare(monkeypatch, quick):
    without_pictures(monkeypatch, of_runs=False)


def test_page_opens_offline_and_is_well_formed(made):
    folder, _ = made
    text = (folder / "report.html").read_text()
    page = Page(text)
    assert page.open == []
    assert all(link.startswith(("#", "data:")) for link in page.fetched)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.fetched if link[0] == "#"} <= set(page.ids)
    assert page.images >= 6
    for part in ("Systems", "Over severity", "Beside the paper", "Tests against clean", "study.json"):
        assert part in text
    headings = [line for line in text.splitlines() if line.startswith("<h2")]
    assert [re.sub("<.*?>", "", line) for line in headings[-2:]] == ["What was evaluated", "How to get it again"]
    assert text.index('class="finding"') < text.index('id="figure-ranking"') < text.index("<h2")
    assert all('<div class="scroll"><table' in part for part in text.split("<h3")[1:])
    assert len(text) < 1_000_000
    assert "@import" not in text
    assert "url(" not in text


def test_markdown_names_pictures_that_are_there(made):
    folder, _ = made
    lines = (folder / "report.md").read_text().splitlines()
    pictures = [line.split("](")[1].rstrip(")") for line in lines if line.startswith("![")]
    assert len(pictures) >= 6
    assert all((folder / name).is_file() for name in pictures)
    rows = [line for line in lines if line.startswith("| rgbd")]
    assert rows
    assert len({line.replace("\\|", "").count("|") for line in rows[:1]}) == 1


def test_tables_are_files(made):
    folder, written = made
    with (folder / "tables" / "settings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(SMALL["settings"]) * len(SMALL["systems"])
    assert {path.relative_to(folder).as_posix() for path in written.files} >= {
        *("report.html", "report.md", "tables/headline.csv", "tables/headline.tex", "figures/paths.svg"),
        *("tables/tests.csv", "tables/paper_colour_static_paper_ate_m.tex", "figures/heat_map.svg"),
    }
    assert not list(folder.rglob("*.unfinished"))
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    assert parquet.read_table(folder / "tables" / "settings.parquet").num_rows == len(rows)


def test_same_folder_gives_the_same_bytes_whatever_the_order_of_rows(tmp_path, quick):
    folder = make_results(tmp_path / "once", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:6:5]})
    once = write_report(folder)
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    for path in once.files:
        (again / path.relative_to(folder)).unlink()
    head, *rows = (again / "tables" / "runs.csv").read_text().splitlines(keepends=True)
    (again / "tables" / "runs.csv").write_text("".join([head, *reversed(rows)]))
    written = write_report(again).files
    assert len(written) == len(once.files)
    for path in written:
        assert path.read_bytes() == (folder / path.relative_to(again)).read_bytes(), path.name


@pytest.mark.parametrize("all_failed", [False, True], ids=["scored", "failed"])
def test_one_run(tmp_path, all_failed):
    only = {"systems": ("my_own",), "scenes": ("room0",), "settings": SETTINGS[:1], "seeds": ("1",)}
    folder = make_results(tmp_path / "results", **only, all_failed=all_failed)
    written = write_report(folder)
    text = (folder / "report.html").read_text()
    assert "1 run of 1 system on 1 sequence" in text
    assert ("1 failed: they gave no estimate" if all_failed else "All were tracked") in text
    assert "incomplete: they" not in text  # what did not happen is not explained
    assert written.missing == ()


def test_what_is_missing_is_said(tmp_path, bare):
    gone = ("room1", "clean", "1", "orb_slam3")
    folder = make_results(tmp_path / "results", **SMALL, skip=[gone])
    (folder / "study.json").unlink()
    (folder / "tables" / "sequences.csv").unlink()
    for name in ("thumbs", "frames.csv", "truth.txt"):
        for path in (folder / "sequences").rglob(name):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path in (folder / "runs").rglob("errors.csv"):
        path.unlink()
    said = " ".join(write_report(folder).missing)
    assert "orb_slam3 has no run on 1 of 10 sequences: room1/clean/seed-1." in said
    for name in ("study.json", "sequences.csv", "errors.csv", "truth.txt"):
        assert name in said
    assert "Missing here" in (folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (lambda text: text.replace("outcome", "ending", 1), ["'outcome'"]),
        (lambda text: text.replace(",40,", ",forty,", 1), ["line 2, column 'frames': ", "'forty'"]),
        (lambda text: text.replace("odometry,1,", "odometry,,", 1), ["line 2, column 'repeat': "]),
        (lambda text: text.replace("room0,", "../x,", 1), ["line 2, column 'scene': ", "'../x'"]),
        (lambda text: text.replace("room0,", "a" * 300 + ",", 1), ["line 2, column 'scene': ", "300 characters"]),
        (lambda text: text.replace(",40,", ",inf,", 1), ["line 2, column 'frames': ", "'inf'"]),
        (lambda text: text.replace("room0,", "a\0b,", 1), ["line 2", "NUL"]),
        (lambda text: text.splitlines(keepends=True)[0], ["no run"]),
        (lambda text: "", []),
    ],
)
def test_damaged_table_is_one_line(tmp_path, change, names):
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:1]})
    path = folder / "tables" / "runs.csv"
    path.write_text(change(path.read_text()))
    refused(write_report, folder, names=[f"{path}: ", *names])


def test_command_makes_the_tables_anew_too(tmp_path, capsys, bare, monkeypatch):
    without_pictures(monkeypatch)
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:6:5]})
    with (folder / "tables" / "runs.csv").open() as file:
        before = list(csv.DictReader(file))
    shutil.rmtree(folder / "tables")
    assert command.main(["report", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"wrote {folder / 'report.html'}" in said
    with (folder / "tables" / "runs.csv").open() as file:
        after = sorted(csv.DictReader(file), key=lambda row: (row["setting"], row["system"]))
    for row, known in zip(after, sorted(before, key=lambda row: (row["setting"], row["system"])), strict=True):
        assert {name: row[name] for name in known} == known
    assert (folder / "report.html").is_file()
    assert command.main(["report", str(tmp_path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_folder_without_results_is_one_line(tmp_path):
    refused(write_report, tmp_path, names="tables/runs.csv: ")


def test_damaged_files_of_runs_are_one_line(tmp_path, bare):
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:2]})
    path = folder / "runs" / "room0" / "clean" / "seed-1" / "rgbd_odometry" / "repeat-1" / "errors.csv"
    text = path.read_text()
    path.write_text(text.replace("error_m", "mistake", 1))
    refused(write_report, folder, names=f"{path}: has no column 'error_m'")
    head, first, *others = text.splitlines()
    assert head.startswith("index,stamp_s,")
    index, _, left = first.split(",", 2)
    path.write_text("\n".join([head, f"{index},inf,{left}", *others]) + "\n")
    refused(write_report, folder, names=[f"{path}: ", "'stamp_s'"])


def test_a_true_path_that_is_no_text_is_one_line(tmp_path, bare):
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:2]})
    path = folder / "sequences" / "room0" / "clean" / "seed-1" / "truth.txt"
    path.write_bytes(path.read_bytes() + b"\xff\xfe")
    refused(write_report, folder, names=f"{path}: ")


@pytest.mark.parametrize(
    ("name", "change", "names"),
    [
        ("study.json", {"kind": 1}, "--out"),
        ("study.json", {"study": [1]}, ["study: ", "copy it again"]),
        ("study.json", {"study": {"protocol": "loose"}}, ["study: protocol: ", "strict, paper"]),
        ("study.json", {"study": {"subject": {"settings": True}}}, "study: subject.settings: "),
        ("study.json", {"study": {"subject": {"settings": {"a": "x"}}}}, "subject.settings.a: "),
        (
            "study.json",
            {"study": {"subject": {"settings": {"a": {"steps": [{"severity": 3}]}}}}},
            "subject.settings.a: steps.0.name: ",
        ),
        ("study.json", {"study": {"systems": None}}, "study: systems: "),
        ("study.json", {"study": {"seeds": [1.5]}}, "study: seeds: "),
        ("study.json", {"study": {"repeats": True}}, "study: repeats: "),
        ("scores.json", {"failure": None}, "remove its folder and run"),
        ("scores.json", {"strict": {"ate_rmse_m": "1"}}, "remove its folder and run"),
        ("indicators.json", {"orb_tracked_mean": [1]}, "remove its folder and run"),
    ],
)
def test_damaged_records_of_a_study_are_one_line(tmp_path, name, change, names):
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",), "settings": SETTINGS[:1]})
    path = next(folder.rglob(name))
    document = json.loads(path.read_text())
    inside = {**document["study"], **change["study"]} if isinstance(change.get("study"), dict) else change.get("study")
    path.write_text(json.dumps({**document, **change, **({"study": inside} if "study" in change else {})}))
    said = refused(lambda: write_tables(StudyResults(folder)), names=names, error=StorageError)
    assert said.startswith(f"{path}: ")


def settings_of(folder):
    results = read_results(folder)
    return settings_table(results, analyse(results.runs, results.sequences)["spread"])


def test_numbers_of_protocol_paper_come_under_their_names(tmp_path):
    # A study of protocol paper names its columns the other way round.
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",)})
    path = folder / "tables" / "runs.csv"
    head, *rows = path.read_text().splitlines(keepends=True)
    names = head.strip().split(",")
    turned = [name.removeprefix("paper.") if name.startswith("paper.") else name for name in names]
    turned = [f"strict.{name}" if name in ("ate_rmse_m", "success_auc", "tracked_share") else name for name in turned]
    expected = settings_of(folder).frame
    path.write_text("".join([",".join(turned) + "\n", *rows]))
    assert settings_of(folder).frame.equals(expected)


def test_maps_are_shown_by_their_names_where_they_were_scored(tmp_path):
    folder = make_results(tmp_path / "results", **{**SMALL, "scenes": ("room0",)})
    path = folder / "tables" / "runs.csv"
    head, *rows = path.read_text().splitlines()
    scored = [f"{row},0.02{number % 10}," for number, row in enumerate(rows)]
    path.write_text("\n".join([f"{head},map.accuracy_m,map.psnr_db", *scored, ""]))
    headings = {column.name: column.heading for column in settings_of(folder).columns}
    assert headings["map.accuracy_m.mean"] == "map accuracy↓ [m]"
    assert "map.psnr_db.mean" not in headings  # which has no value in any run


# What the search of a threshold writes when it has ended, of a system that bears up to 15 frames.
SEARCHED = {
    "identity": {"system": {"name": "alpha"}, "success": "success_10cm"},
    "found": {
        "axis": {"perturbation": "desync", "parameter": "offset", "unit": "frames", "mild": 1, "worst": 40}
        | {"logarithmic": True, "whole": True},
        "verdict": "found",
        "runs": 18,
        "threshold": 14.9,
        "mild": 11.64,
        "worst": 18.8,
    },
}


def test_thresholds_in_the_folder_are_a_part(made, tmp_path, bare, monkeypatch):
    without_pictures(monkeypatch)
    folder = tmp_path / "results"
    shutil.copytree(made[0], folder)
    assert "Thresholds" not in (folder / "report.md").read_text()
    searches = folder / "thresholds" / "desync.offset"
    searches.mkdir(parents=True)
    (searches / "alpha.threshold.json").write_text(json.dumps({"kind": KIND, "format": FORMAT, **SEARCHED}))
    write_report(folder)
    text = (folder / "report.html").read_text()
    assert ">Thresholds</h2>" in text
    assert "14.9 [11.6, 18.8] frames" in text
    assert b"desync: offset [frames]" in (folder / "figures" / "thresholds.svg").read_bytes()
    (row,) = csv.DictReader((folder / "tables" / "thresholds.csv").open(newline=""))
    assert (row["system"], float(row["threshold"]), row["runs"]) == ("alpha", 14.9, "18")


@pytest.mark.parametrize(
    ("verdict", "ends", "said"),
    [
        ("found", (2.0, 1.5, 3.25), "2 [1.5, 3.25] m"),
        ("ended", (2.0, None, None), "2 [before 0.5, beyond 9] m"),
        ("holds", (None, None, None), "beyond 9 m"),
        ("fails", (None, None, None), "before 0.5 m"),
    ],
)
def test_thresholds_beyond_what_was_searched_are_no_number(verdict, ends, said):
    threshold, mild, worst = ends
    row = {"unit": "m", "verdict": verdict, "searched_from": 0.5, "searched_to": 9.0}
    assert threshold_text({**row, "threshold": threshold, "mild_end": mild, "worst_end": worst}) == said
