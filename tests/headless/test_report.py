# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's own arithmetic: a measurement that is wrong is worse than none."""

import json
import sys
from dataclasses import asdict

import numpy as np
import pytest
from worlds import ROOT

sys.path.insert(0, str(ROOT / "headless"))

from bench import report, results

from noisy_world.scenes.polygon_mesh import Mesh


def test_the_pareto_front_is_what_nothing_beats():
    points = [(1.0, 5.0), (2.0, 3.0), (3.0, 4.0), (0.5, 9.0), (2.0, 2.0), (4.0, 2.0), (5.0, 1.0)]
    beaten = {k for k, p in enumerate(points) if any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)}
    assert report.pareto_front(points) == sorted(set(range(7)) - beaten, key=lambda k: points[k])
    assert report.pareto_front([]) == []


def test_a_spread_is_median_and_range():
    found = results.spread([1.0, 2.0, 3.0, 4.0, 5.0])
    assert (found.median, found.relative, found.turns) == (3.0, 4 / 3, 5)
    assert results.spread_of_ratios([2.0, 6.0], [1.0, 2.0]).median == 2.5
    assert results.spread([]).text(" s") == "-"
    assert found.text(" s") == "3 s ± 133 %"


def test_edges_are_jumps_and_what_is_near_them():
    depth_m = np.full((9, 20), 2.0)
    depth_m[:, 10:] = 2.2
    assert np.flatnonzero(report.edges(depth_m)[4]).tolist() == list(range(7, 13))
    depth_m[:, 10:] = 2.09  # less than 5 %
    assert not report.edges(depth_m).any()
    depth_m[4, 4] = 0.0  # void
    assert report.edges(depth_m).sum() > 9


def test_depth_errors_tell_edges_from_the_rest(tmp_path):
    true_m = np.full((40, 40), 2.0)
    true_m[:, 20:] = 4.0
    true_m[0, 0] = 0.0
    depth_m = true_m.copy()
    depth_m[10, 5] *= 1.001  # off the edges
    depth_m[20, 20] = 2.0  # at the edge, the other surface
    depth_m[30, 30] = 0.0
    np.save(tmp_path / "0.npy", true_m)
    np.savez(tmp_path / "0.npz", depth_m=depth_m.astype(np.float32))
    found = report.cast_errors(tmp_path, tmp_path, [0])
    edge = report.edges(true_m)
    assert found["off_median"] < 1e-7
    assert found["off_beyond_2e-4"] == pytest.approx(1 / ((~edge).sum() - 1), rel=1e-6)
    assert found["edge_wrong_surface"] == pytest.approx(1 / (edge.sum() - 1), rel=1e-6)
    assert found["void_differs"] == 1 / 1600


def test_colour_errors_are_the_textbook_s(tmp_path):
    folders = [tmp_path / name for name in ("a", "b")]
    for folder, value in zip(folders, (100, 110), strict=True):
        folder.mkdir()
        np.savez(folder / "0.npz", rgb=np.full((32, 32, 3), value / 255, np.float32))
    found = report.rgb_errors(*folders, [0])
    assert found["psnr_db"] == pytest.approx(20 * np.log10(255 / 10), abs=1e-6)
    # SSIM of two constants is its luminance term alone.
    c1 = (0.01 * 255) ** 2
    assert found["ssim"] == pytest.approx((2 * 100 * 110 + c1) / (100**2 + 110**2 + c1), abs=1e-4)


def test_a_contestant_that_dies_is_told_of_with_its_last_words():
    with pytest.raises(results.ContestantError, match=r"broken: .*no such thing"):
        results.Contestant("broken", [sys.executable, "-c", "raise SystemExit('no such thing')"])


def test_a_contestant_answers_beside_the_noise_that_others_print():
    lines = ["import sys", "print('noise')", "print('@{}', flush=True)"]
    lines += ["for line in sys.stdin:", "    print('x')", "    print('@' + line, flush=True)"]
    echo = "\n".join(lines)
    item = results.Contestant("echo", [sys.executable, "-c", echo])
    assert item.start == {}
    assert item.ask(do="time", frame_s=1.5) == {"do": "time", "frame_s": 1.5}
    item.stop()


def test_the_million_quads_are_a_million(tmp_path):
    from noisy_world.scenes.ply import read_ply

    report.write_million(tmp_path)
    mesh = read_ply(tmp_path / "million.ply")
    assert isinstance(mesh, Mesh)
    assert len(mesh.face_starts) == 1_000_000
    assert (mesh.face_sizes == 4).all()
    assert len(np.loadtxt(tmp_path / "million.txt")) == 40


def fake_results():
    spread = results.spread([1.0, 1.1, 1.2])
    shapes = {"plane": {"max": 1e-6, "p99": 1e-7, "edge_max": 0.0, "missed": 0}}
    cast = {"off_p999": 1e-5, "edge_wrong_surface": 0.01, "void_differs": 0.0}
    rgb = {"psnr_db": 45.0, "ssim": 0.99}
    found = results.Results(report.machine())
    found.rows = [
        results.EngineRow(engine, k, float(k), spread, spread, 1.0, 2.0, 10**9, rgb, shapes, cast)
        for k, engine in enumerate(("cycles", "eevee", "workbench"), 1)
    ]
    found.others = [{"name": "Embree", "frame_s": asdict(spread), "loading_s": 1.0}]
    found.million = {
        "first_frame_s": 1.0, "loading_s": 2.0, "frame_s": asdict(spread), "embree_s": None, "times_embree": None,
        "pair": asdict(spread), "peak_bytes": 10**9, "resident_bytes": {"20": 10**9, "200": 10**9}, "growth": 0.0,
    }  # fmt: skip
    found.needs = [
        {
            "name": "clean", "samples": 1, "passes": ["z"], "lights": 0, "bounces": 0, "libraries": ["numpy"],
            "first_frame_s": 1.0, "peak_bytes": 10**9, "frame_s": asdict(spread), "of_clean": asdict(spread),
            "of_everything": asdict(spread),
        }
    ]  # fmt: skip
    found.hard_cases = [{"title": "A case", "columns": ["a", "b"], "rows": [["x", 1e-7]], "note": "A note."}]
    return found


def test_the_report_lays_out_every_figure(tmp_path):
    text = results.markdown(fake_results())
    assert "nan" not in text
    for words in (
        "| workbench | 3 | 3 | 1.1 s ± 18 %",
        "45.0 dB",
        "| x | 1e-07 |",
        "A note.",
        "1000 MB",
        "| Embree | 1.1 s",
    ):
        assert words in text, words
    for block in text.split("\n\n"):
        lines = block.splitlines()
        if lines[0].startswith("|"):
            assert len({line.count("|") for line in lines}) == 1
    json.dumps(asdict(fake_results()))
    pytest.importorskip("matplotlib", reason="matplotlib comes with `make bench`")
    report.draw(fake_results(), tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000
