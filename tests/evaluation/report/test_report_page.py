# SPDX-License-Identifier: GPL-3.0-or-later
"""The page as a reader uses it, in a browser: figures, filters, sorting, runs that open, settings side by side."""

import csv
import shutil

import pytest
from chromium import READY, browser, find_chromium
from results_made import SMALL, make_results, without_analyses
from worlds import ROOT

pytest.importorskip("jinja2", reason="the extra evaluate is not installed")
pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from noisy_world.evaluate.report import write_report

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="needs chromium")

DIALOG = "document.getElementById('run')"


@pytest.fixture(scope="module")
def tab():
    with browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A results folder with its report."""
    folder = make_results(tmp_path_factory.mktemp("results"), **SMALL)
    with pytest.MonkeyPatch.context() as patch:
        without_analyses(patch)
        write_report(folder)
    return folder


@pytest.fixture(scope="module")
def page(tab, made):
    tab.size(1400)
    tab.open((made / "report.html").as_uri())
    tab.run(READY)
    return tab


def cell(system, setting):
    return f"document.querySelector('#grid button[data-system={system}][data-setting={setting}]')"


def test_figures_are_shown_in_the_shape_of_the_window(page):
    wide = "[...document.images].map((image) => image.decode().then(() => image.naturalWidth))"
    sizes = {}
    for width_px in (1400, 400):
        page.size(width_px)
        sizes[width_px] = page.run(f"Promise.all({wide})")
        assert min(sizes[width_px]) > 0
        assert page.run("document.documentElement.scrollWidth") <= width_px
    assert any(narrow < wide for narrow, wide in zip(sizes[400], sizes[1400], strict=True))
    page.size(1400)
    assert page.complaints() == []


def rows(name):
    return f"[...document.querySelectorAll('table[data-name={name}] tbody tr')].filter((row) => !row.hidden)"


def test_words_filter_rows_and_a_heading_sorts_them(page, made):
    every = page.run(f"{rows('runs')}.length")
    with (made / "tables/runs.csv").open() as file:
        runs = list(csv.DictReader(file))
    assert every == len(runs)
    field = "document.querySelector('table[data-name=runs]').parentElement.previousElementSibling.firstElementChild"
    filtered = f"""(() => {{ const field = {field}; field.value = "ROOM1 orb"; field.dispatchEvent(new Event("input"));
      return {rows("runs")}.map((row) => row.textContent); }})()"""
    found = page.run(filtered)
    assert len(found) == sum(run["scene"] == "room1" and run["system"] == "orb_slam3" for run in runs) > 0
    assert all("room1" in text and "orb_slam3" in text for text in found)
    assert page.run(f"{field}.nextElementSibling.textContent") == f"{len(found)} of {every} rows"
    page.run(f"(() => {{ {field}.value = ''; {field}.dispatchEvent(new Event('input')); }})()")
    heads = "[...document.querySelectorAll('table[data-name=runs] th')]"
    place = page.run(f"{heads}.findIndex((head) => head.textContent.startsWith('ATE'))")
    page.run(f"document.querySelectorAll('table[data-name=runs] th')[{place}].querySelector('button').click()")
    shown = page.run(f"{rows('runs')}.map((row) => row.cells[{place}].dataset.v ?? '')")
    known = [float(text) for text in shown if text]
    assert known == sorted(float(run["ate_rmse_m"]) for run in runs if run["ate_rmse_m"])
    assert "" not in shown[: len(known)]  # what has no value stays last


def test_a_cell_opens_its_runs(page, made):
    page.run(f"{cell('rgbd_odometry', 'frost_s5_dynamic')}.click()")
    assert page.run(f"{DIALOG}.open")
    said = page.run(f"{DIALOG}.textContent")
    assert "rgbd_odometry in frost_s5_dynamic: 2 runs" in said
    assert "room0/frost_s5_dynamic" in said
    assert page.run(f"{DIALOG}.querySelectorAll('svg.paths').length") == 2
    assert page.run(f"{DIALOG}.querySelectorAll('svg.errors path').length") >= 2
    axis = page.run(
        f"[...{DIALOG}.querySelector('svg.errors').querySelectorAll('text')].map((text) => text.textContent)"
    )
    assert axis[-4:] == ["0 s", "0.5 s", "1 s", "1.5 s"]  # 40 frames of 0.05 s
    lost = page.run(f"[...{DIALOG}.querySelectorAll('svg.errors path')][1].getBBox().width")
    assert lost == pytest.approx((640 - 64) * 4 / 39, rel=0.01)  # four of them have no pose
    assert page.run(f"Promise.all([...{DIALOG}.querySelectorAll('img')].map((image) => image.decode()))") is not None
    page.run(f"{DIALOG}.close()")


def test_a_run_of_the_table_opens_with_its_own_error(page, made):
    button = f"{rows('runs')}.map((row) => row.querySelector('button.open'))[0]"
    texts = page.run(f"[...{rows('runs')}[0].cells].map((cell) => cell.textContent)")
    page.run(f"{button}.click()")
    title = page.run(f"{DIALOG}.querySelector('h3').textContent")
    assert all(text in title for text in (texts[0], texts[1]))
    with (made / "tables/runs.csv").open() as file:
        (run,) = (
            run for run in csv.DictReader(file)
            if title == f"{run['system']}, {run['scene']}/{run['setting']}, seed {run['seed']}, run {run['repeat']}"
        )  # fmt: skip
    ate_mm = f"ATE {1e3 * float(run['ate_rmse_m']):.3g} mm"
    assert ate_mm in page.run(f"{DIALOG}.textContent")
    page.run(f"{DIALOG}.close()")


def test_two_settings_stand_side_by_side(page):
    boxes = "[...document.querySelectorAll('.compared')]"
    page.run(f"{boxes}.slice(0, 2).forEach((box) => box.click())")
    names = page.run(f"{boxes}.slice(0, 2).map((box) => box.value)")
    heads = page.run("[...document.querySelectorAll('#compared th')].map((head) => head.textContent)")
    assert heads[1:3] == names
    assert page.run("document.querySelectorAll('#compared svg').length") == 2
    page.run(f"{boxes}[0].click()")
    assert page.run("document.getElementById('compared').hidden")
    assert page.complaints() == []


def test_the_record_of_a_study_opens_too(tab, tmp_path, monkeypatch):
    without_analyses(monkeypatch)
    folder = shutil.copytree(ROOT / "docs/data/narrow_camera", tmp_path / "record")
    write_report(folder)
    tab.open((folder / "report.html").as_uri())
    tab.run(READY)
    tab.run(f"{rows('runs')}[0].querySelector('button').click()")
    assert "this is a record" in tab.run(f"{DIALOG}.textContent")
    assert tab.complaints() == []
