# SPDX-License-Identifier: GPL-3.0-or-later
"""From each layout to each layout: intrinsics, stamps, depth and poses, as parsers of the tests' own read them."""

import json

import numpy as np
import pytest
from foreign_readers import READERS
from stored_sequences import write_euroc
from runs import run
from written import world, write_tum_path

CAMERA = {"width": 8, "height": 6, "fx": 4.123456789012345, "fy": 3.9, "cx": 1e-5, "cy": -7.25}
# Irregular, on a real clock, in whole microseconds.
STAMPS = ["1400000000.000100", "1400000000.033433", "1400000000.101", "1400000000.133333", "1400000000.2"]
# How much finer than the other layouts' stamps may be told: microseconds, float64 on such a clock, nanoseconds.
STEP_NS = {"tum": 500, "replica": 120, "euroc": 0, "tum_vi": 0, "vslamlab": 0}


pytestmark = pytest.mark.usefixtures("no_blender")


def convert(folder, source, **output):
    """Write a recording again with no key but the layout's; return the sequence's folder."""
    folder.mkdir(parents=True)
    scene = {"name": "box", "sequence": str(source)}
    document = {"scenes": [scene], "render": {"backend": "reference"}, "output": output}
    (folder / "p.json").write_text(json.dumps(document))
    run(folder / "p.json", folder / "out")
    return folder / "out/clean/box"


def assert_kept(before, after, target, source):
    assert after.camera == before.camera
    slack_ns = max(STEP_NS[target], STEP_NS[source])
    for name in ("rgb_ns", "depth_ns", *(["pose_ns"] if "replica" not in (target, source) else [])):
        apart = np.abs(np.array(getattr(after, name)) - np.array(getattr(before, name)))
        assert apart.max() <= slack_ns, name
    step_m = 0.5 / after.depth_scale
    assert np.abs(after.depth_m - before.depth_m).max() <= step_m * 1.001
    assert np.allclose(after.c2w, before.c2w, atol=1e-12)


@pytest.mark.parametrize(
    "output",
    [
        {"colour": "rgb", "image": "png"},
        {"colour": "grey", "image": "png", "depth_scale_per_m": 1000},
        {"colour": "rgb", "image": "jpg", "depth_scale_per_m": 8000},
    ],
    ids=["rgb", "grey", "jpg"],
)
@pytest.mark.parametrize("layout", list(READERS))
def test_what_is_written_is_read_and_written_again(tmp_path, layout, output):
    if output["image"] == "jpg" and layout not in ("replica", "vslamlab"):
        output = {**output, "image": "png"}
    preset = world(tmp_path / "w", layout, output=output, camera=CAMERA)
    run(preset, tmp_path / "first", overrides=[write_tum_path(tmp_path / "w", STAMPS)])
    source = tmp_path / "first/clean/box"
    before = READERS[layout](source)
    assert before.camera == tuple(CAMERA.values())
    assert before.rgb_ns == [int(stamp.replace(".", "").ljust(19, "0")) for stamp in STAMPS]
    for target in READERS:
        again = convert(tmp_path / target, source, layout=target, colour=output["colour"])
        after = READERS[target](again)
        assert_kept(before, after, target, layout)
        assert after.depth_scale == (6553.5 if target == "replica" else 5000)
        back = READERS[layout](convert(tmp_path / f"{target}_back", again, **{**output, "layout": layout}))
        assert back.camera == before.camera
        assert np.abs(np.array(back.rgb_ns) - before.rgb_ns).max() <= STEP_NS[target]
        assert np.abs(back.depth_m - before.depth_m).max() <= 0.5 / after.depth_scale + 0.5 / before.depth_scale + 1e-6
        if output["image"] == "png" and target != "replica":
            assert all(np.array_equal(a, b) for a, b in zip(before.rgb, back.rgb, strict=True))


@pytest.mark.parametrize("target", list(READERS))
def test_depth_and_poses_with_stamps_of_their_own(tmp_path, target):
    preset = world(tmp_path / "w", "tum", camera=CAMERA)
    run(preset, tmp_path / "first", overrides=[write_tum_path(tmp_path / "w", STAMPS)])
    source = tmp_path / "first/clean/box"
    for name, late_us in (("depth.txt", [7000, -3001, 12, 0, 19000]), ("groundtruth.txt", [-5, 4, 0, -15000, 1])):
        rows = [row.split() for row in (source / name).read_text().splitlines() if not row.startswith("#")]
        for row, late in zip(rows, late_us, strict=True):
            row[0] = f"{float(row[0]) + late / 1e6:.6f}"
        (source / name).write_text("".join(" ".join(row) + "\n" for row in rows))
    again = READERS[target](convert(tmp_path / "a", source, layout=target))
    rgb_us = [int(stamp.replace(".", "").ljust(16, "0")) for stamp in STAMPS]
    assert np.abs(np.array(again.rgb_ns) - 1000 * np.array(rgb_us)).max() <= STEP_NS[target]
    late_us = np.array([7000, -3001, 12, 0, 19000])
    assert np.abs(np.array(again.depth_ns) - 1000 * (np.array(rgb_us) + late_us)).max() <= STEP_NS[target]
    if target != "replica":
        late_us = np.array([-5, 4, 0, -15000, 1])
        assert np.abs(np.array(again.pose_ns) - 1000 * (np.array(rgb_us) + late_us)).max() <= max(STEP_NS[target], 120)
    if target == "tum":  # the very rows, but for the names
        for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
            tables = [
                [line.split() for line in (place / name).read_text().splitlines() if not line.startswith("#")]
                for place in (source, tmp_path / "a/out/clean/box")
            ]
            assert [float(row[0]) for row in tables[0]] == [float(row[0]) for row in tables[1]]
            if name == "groundtruth.txt":
                assert np.allclose(*(np.array(rows, dtype=float) for rows in tables), atol=1e-12)
            else:
                assert tables[0] == tables[1]


def test_nanoseconds_of_a_real_clock_are_kept_exactly(tmp_path):
    write_euroc(tmp_path / "given")
    exact = [1403636579763555584, 1403636579813555457]
    for name in ("cam0", "depth0", "state_groundtruth_estimate0"):
        path = tmp_path / "given/mav0" / name / "data.csv"
        text = path.read_text()
        for old, new in zip((1403636579760000000, 1403636579810000000), exact, strict=True):
            text = text.replace(str(old), str(new))
            image = path.parent / "data" / f"{old}.png"
            if image.exists():
                image.rename(image.with_name(f"{new}.png"))
        path.write_text(text)
    tum = convert(tmp_path / "tum", tmp_path / "given", layout="tum")
    rows = [row.split()[0] for row in (tum / "rgb.txt").read_text().splitlines() if not row.startswith("#")]
    assert rows == ["1403636579.763555584", "1403636579.813555457"]
    for number, source in enumerate((tmp_path / "given", tum)):
        again = READERS["euroc"](convert(tmp_path / f"euroc{number}", source, layout="euroc"))
        assert again.rgb_ns == again.depth_ns == exact
        assert again.pose_ns == exact or source == tum
    replica = READERS["replica"](convert(tmp_path / "replica", tmp_path / "given"))
    assert np.abs(np.array(replica.rgb_ns) - exact).max() <= 120
