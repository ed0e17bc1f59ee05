# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings that differ by known noise are told apart by that noise, and equal ones by nothing."""

import contextlib
import io
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from made_recordings import write_tum
from runs import run

from noisy_world.cli import command
from noisy_world.measure import looking
from noisy_world.measure.comparison import compared
from noisy_world.measure.comparison_page import page
from noisy_world.measure.figure import BLOCKS, Figure, jackknifed
from noisy_world.measure.looking import RecordingFigures

COUNT, HIGH, WIDE = 12, 144, 192
SCALE = 5000.0
CAMERA = "192,144,160,160,95.5,71.5"
COLOUR, DEPTH = 2.0, 1.6  # times the noise of the first recording


def write(folder, seed, colour_std, depth_per_m):
    """Write a recording of a smooth wall at a slant, 1 to 3.6 m away: white noise on colour, by z^2 on depth."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:HIGH, :WIDE]
    z = 1 / (1 - 0.72 * (0.9 * u / WIDE + 0.1 * v / HIGH))
    grey = (40 + 160 * u / WIDE)[..., None]
    colour = [np.rint(grey + rng.normal(0, 255 * colour_std, (HIGH, WIDE, 3))) for _ in range(COUNT)]
    depth_m = [z + rng.normal(0, 1, z.shape) * depth_per_m * z**2 for _ in range(COUNT)]
    rows = np.tile([0.0, 0, 0, 0, 0, 0, 1], (COUNT, 1))
    images = [image.clip(0, 255).astype(np.uint8) for image in colour]
    return write_tum(folder, images, [(image * SCALE).round() for image in depth_m], rows)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two recordings, of which the second has COLOUR and DEPTH times the noise, and the first again by other draws."""
    folder = tmp_path_factory.mktemp("two")
    return (
        write(folder / "a", 1, 0.02, 0.004),
        write(folder / "b", 2, 0.02 * COLOUR, 0.004 * DEPTH),
        write(folder / "again", 3, 0.02, 0.004),
    )


@pytest.fixture(scope="module", autouse=True)
def measured_once():
    """Each recording is measured once for all tests of this file."""
    known, measured = {}, looking.measured

    def again(name, source, camera):
        where = source.stored.folder
        if where not in known:
            known[where] = measured(name, source, camera)
        return known[where]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(looking, "measured", again)
        yield


@pytest.fixture(scope="module")
def compared_once(recordings):
    """The first two compared, as JSON and as a page in a folder that was not there."""
    a, b, _ = recordings
    out = a.parent / "new" / "page.html"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert command.main(["compare", str(a), str(b), "--camera", CAMERA, "--json", "--html", str(out)]) == 0
    return json.loads(printed.getvalue()), out


def test_known_noise_is_ranked_first_and_its_ratio_lies_within(compared_once):
    found = compared_once[0]["differences"]
    known = {"colour_noise": COLOUR, "colour_gaussian_std": COLOUR, "depth_noise_m": DEPTH}
    # Light is convex in the values of pixels, so that noise raises its mean, which is known very well here.
    names = [row["name"] for row in found if not row["name"].startswith("mean_light")]
    assert set(names[:4]) == {*known, "depth_noise_quadratic_per_m"}
    rows = {row["name"]: row for row in found}
    assert len(rows["colour_noise"]["places"]) >= 6
    assert len(rows["depth_noise_m"]["places"]) >= 5
    for name, times in known.items():
        ratio = rows[name]["ratio"]
        assert ratio["low"] < times < ratio["high"]
        assert ratio["value"] == pytest.approx(times, rel=0.05)
    assert not rows["depth_correlation"]["places"][0]["differs"]
    apart = [abs(row["standard_errors"]) for row in found if row["standard_errors"] is not None]
    assert apart == sorted(apart, reverse=True)


def test_equal_recordings_differ_by_nothing(recordings, capsys):
    a, _, again = recordings
    assert command.main(["compare", str(a), str(a), "--camera", CAMERA]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "found      nothing differs"
    assert command.main(["compare", str(a), str(again), "--camera", CAMERA, "--json"]) == 0
    for row in json.loads(capsys.readouterr().out)["differences"]:
        assert abs(row["standard_errors"] or 0) < 4, row["name"]


def make_dataset(folder, seed, settings):
    """Make a dataset of two frames of a recording."""
    grey = np.full((72, 96), 100 + seed, np.uint8)
    write_tum(folder.parent / f"seen{seed}", [np.dstack([grey] * 3)] * 2, [grey * 50] * 2, np.eye(7)[[6, 6]])
    camera = "{width: 96, height: 72, fx: 80, fy: 80, cx: 47.5, cy: 35.5}"
    scenes = f"[{{name: room, sequence: {folder.parent}/seen{seed}}}]"
    text = (
        f"camera: {camera}\nscenes: {scenes}\n{settings}\nrender: {{backend: reference}}\noutput: {{layout: euroc}}\n"
    )
    preset = folder.parent / f"{folder.name}.yaml"
    preset.write_text(text)
    run(preset, folder)


def looked(monkeypatch):
    """Put figures in the place of what is measured, by the recording's folder; return what was asked for."""
    asked = []

    def measured(name, source, camera):
        where = source.stored.folder
        asked.append(where.parent.name + "/" + where.name)
        std = {"twin": 0.02, "fog": 0.05}[where.parent.name] * (2 if "other" in where.parts else 1)
        figures = {"std": Figure.within("std", std, 0.001, 9), "c": Figure.exact("c", std, 1).on("colour_noise", 9.0)}
        return RecordingFigures(name, COUNT, (WIDE, HIGH), 1.0, 2, figures)

    monkeypatch.setattr("noisy_world.measure.looking.measured", measured)
    return asked


def test_sequences_of_two_datasets_are_compared_by_their_names(tmp_path, monkeypatch, capsys):
    settings = "settings: [{name: clean}, {name: fog, perturb: [{fog: {severity: 1}}]}, {name: twin}]"
    for name, seed in (("one", 1), ("other", 2)):
        make_dataset(tmp_path / name, seed, settings if name == "one" else settings.replace("{name: clean}, ", ""))
    asked = looked(monkeypatch)
    page = tmp_path / "page.html"
    words = ["compare", str(tmp_path / "one"), str(tmp_path / "other")]
    assert command.main([*words, "--html", str(page)]) == 0
    out = capsys.readouterr().out
    assert asked == ["fog/room", "twin/room"] * 2
    assert "only A     clean/room: B has no such sequence" in out
    # .05 is farther from .1 than .02 from .04, by equal errors.
    assert out.index("fog/room: std") < out.index("twin/room: std")
    assert "<h2>fog/room: Photon transfer" in page.read_text()
    assert command.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["a"]["sequences"]) == ["fog/room", "twin/room"]
    assert {row["name"] for row in told["differences"]} >= {"fog/room: std", "twin/room: colour_noise"}
    # A single sequence goes with the only one of a setting twin.
    asked.clear()
    assert command.main(["compare", str(tmp_path / "one/fog/room"), str(tmp_path / "other")]) == 0
    assert asked == ["fog/room", "twin/room"]


class Page(HTMLParser):
    """What a page has: its tags with their attributes, and its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def test_a_page_has_the_curves_of_both_and_fetches_nothing(compared_once):
    out = compared_once[1]
    text = out.read_text(encoding="utf-8")
    assert len(text.encode()) < 1_000_000
    seen = Page(text)
    names = [tag for tag, _ in seen.tags]
    assert not {"script", "link", "img", "iframe"} & set(names)
    assert not any({"src", "href"} & attributes.keys() for _, attributes in seen.tags)
    drawings = [ET.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", text, re.S)]
    sides = [{title.text[0] for title in svg.iter("title")} for svg in drawings]  # a mark a point
    assert sides.count({"A", "B"}) >= 3
    assert all(side and side <= {"A", "B"} for side in sides)  # of what only one tells, its curve alone
    assert "colour_gaussian_std" in seen.text
    assert list(out.parent.iterdir()) == [out]


def test_texts_of_a_page_are_escaped():
    name = "<script>alert('x')</script>\udcff\x00&"
    why = '<b>void</b> & "so"'
    a = {name: Figure.within(name, 1.0, 0.1, 5), "x": Figure.none("x", why)}
    b = {name: Figure.within(name, 2.0, 0.1, 5), "x": Figure.exact("x", 1.0, 3)}
    text = page((name, "b"), a, b, compared(a, b))
    text.encode()
    seen = Page(text)
    assert not {"script", "b"} & {tag for tag, attributes in seen.tags if "class" not in attributes}
    assert seen.text.count("<script>alert('x')</script>") == 3
    assert why in seen.text


@pytest.mark.parametrize(
    ("words", "status_said"),
    [
        (("none", "{a}"), (1, "is not there")),
        (("{a}", "{empty}"), (1, "empty")),
        (("{a}", "{b}", "--html", "{b}"), (2, ".html")),
        (("{a}", "{b}", "--html", "{folder}"), (1, "is a folder")),
        (("{a}", "{preset}"), (1, "nothing is recorded there")),
        (("{a}", "{several}"), (1, "holds 2 recordings (one, two)")),
        (("{several}", "{others}"), (1, "sequences of the same names")),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(recordings, tmp_path, capsys, words, status_said):
    a, b, _ = recordings
    (tmp_path / "empty").mkdir()
    (tmp_path / "folder.html").mkdir()
    preset, several, others = (tmp_path / name for name in ("p.yaml", "two.yaml", "others.yaml"))
    room = "{name: made, mesh: 'embedded:room', trajectory: {handheld: {frames: 5}}}"
    camera = "camera: {width: 192, height: 144, fx: 160, fy: 160, cx: 95.5, cy: 71.5}\n"
    preset.write_text(f"scenes: [{room}]\nsettings: [{{name: clean}}]\n")
    for file, names in ((several, ("one", "two")), (others, ("three", "four"))):
        scenes = ", ".join(f"{{name: {name}, sequence: {which}}}" for name, which in zip(names, (a, b), strict=True))
        file.write_text(f"{camera}scenes: [{scenes}]\nsettings: [{{name: clean}}]\n")
    places = {"a": a, "b": b, "empty": tmp_path / "empty", "folder": tmp_path / "folder.html"}
    filled = [word.format(**places, preset=preset, several=several, others=others) for word in words]
    try:
        ended = command.main(["compare", *filled, "--camera", CAMERA])
    except SystemExit as error:
        ended = error.code
    line = capsys.readouterr().err.strip()
    status, said = status_said
    assert ended == status, line
    assert said in line
    assert line.isprintable()


def curve(law, places, share=0.02):
    """Figures of a curve: law, a function of the place; share: its relative standard error."""
    made = [Figure.within(f"c_at_{place}", law(place), share * law(place), 9).on("c", place) for place in places]
    return {figure.name: figure for figure in made}


def test_curves_are_compared_where_both_have_points():
    one, two = curve(lambda z: 0.002 * z**2, [0.5, 0.9, 1.3, 2.0]), curve(lambda z: 0.006 * z**2, [1.0, 1.4, 1.9, 5.0])
    found = compared(one, two)
    (row,) = found.rows
    assert [part.a.at for part in row.parts] == pytest.approx([1.0, 1.35, 1.95])
    for part in row.parts:  # a power of the distance is interpolated exactly
        assert part.ratio[0] == pytest.approx(3)
        assert part.a.value == pytest.approx(0.002 * part.a.at**2)
    # Relative errors of .02 on both sides: .02 sqrt(2) of the logarithm, within 2.365 of them.
    assert row.parts[0].ratio[2] / 3 == pytest.approx(np.exp(2.365 * 0.02 * 2**0.5), rel=0.01)
    assert row.differing == 3
    assert {(item.whose, item.figure.at) for item in found.one_sided} == {("a", 0.5), ("b", 5.0)}
    (back,) = compared(two, one).rows
    for part, other in zip(row.parts, back.parts, strict=True):
        assert part.standard_errors == pytest.approx(-other.standard_errors)
        assert part.ratio == pytest.approx((1 / other.ratio[0], 1 / other.ratio[2], 1 / other.ratio[1]))
    apart = compared(curve(lambda z: z, [1.0, 2.0]), curve(lambda z: z, [3.0, 4.0]))
    assert not apart.rows
    assert len(apart.one_sided) == 4


def test_what_only_one_tells_is_said_with_the_reason():
    a = {"x": Figure.exact("x", 1.0, 3), "y": Figure.none("y", "dark"), "z": Figure.none("z", "still")}
    b = {"x": Figure.none("x", "short"), "y": Figure.none("y", "blind")}
    found = compared(a, b)
    assert [(item.whose, item.figure.name, item.why) for item in found.one_sided] == [("a", "x", "short")]
    assert found.untold == (("y", "dark", "blind"), ("z", "still", "not measured"))


def test_counted_figures_come_after_estimated_ones():
    names = {"little": (1.0, 1.01), "much": (1.0, 3.0), "jitter": (0.0, 2e-16), "rate": (20.0, 20.0 + 1e-9)}
    a, b = ({name: Figure.exact(name, pair[side], 9) for name, pair in names.items()} for side in (0, 1))
    a["sure"], b["sure"] = Figure.within("sure", 1.0, 0.1, 9), Figure.within("sure", 1.1, 0.1, 9)
    rows = compared(a, b).rows
    assert [row.name for row in rows] == ["sure", "much", "little", "jitter", "rate"]
    assert [row.differing for row in rows] == [0, 1, 1, 0, 0]


def test_intervals_of_differences_and_ratios_cover_what_is_true():
    # Means of BLOCKS normal draws, whose errors the draws tell themselves: true means are 3 and 4.
    rng = np.random.default_rng(7)
    trials, covered, ratio_covered = 2000, 0, 0
    for _ in range(trials):
        sides = []
        for mean, std in ((3.0, 0.6), (4.0, 1.2)):
            draws = rng.normal(mean, std, BLOCKS)
            left_out = np.array([np.delete(draws, block).mean() for block in range(BLOCKS)])
            sides.append({"x": Figure.within("x", float(draws.mean()), jackknifed(left_out), BLOCKS)})
        (part,) = compared(*sides).rows[0].parts
        covered += part.interval[0] < 1.0 < part.interval[1]
        ratio_covered += part.ratio[1] < 4 / 3 < part.ratio[2]
    assert 0.94 < covered / trials < 0.98  # 7 degrees of freedom are fewer than both have together
    assert 0.94 < ratio_covered / trials < 0.98
