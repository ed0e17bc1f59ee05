# SPDX-License-Identifier: GPL-3.0-or-later
"""Layouts as objects: their names, and sequences that are told apart and read from files written by hand."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from refusals import refused
from recorded_layouts import WRITTEN
from stored_sequences import write_euroc

from worlds import ROOT

from noisy_world.layouts import LAYOUTS, SequenceFacts, find_sequence
from noisy_world.layouts.asl import stamp_text
from noisy_world.core.geometry import Intrinsics
from noisy_world.preset.keys import OutputSpec
from noisy_world.preset.keys import check_document
from noisy_world.core.schema import Choice, ConfigPath, key, list_keys, parse
from noisy_world.trajectories.rig import Rig, Sensor
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import nanoseconds
from noisy_world.core.trajectory import FrameStamps, Stamps, Trajectory

REPLICA_POSE = "1 0 0 {} 0 1 0 0 0 0 1 0 0 0 0 1"


def image(path, value, shape=(6, 8, 3), dtype=np.uint8):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full(shape, value, dtype))


# --- names ---


def test_names_are_those_that_readers_expect():
    names = {name: OutputSpec(name).format.names([0.0, 1305031102.175304]) for name in LAYOUTS}
    assert (names["replica"].rgb(1), names["replica"].depth(1)) == (
        "results/frame000001.jpg",
        "results/depth000001.png",
    )
    assert (names["tum"].rgb(1), names["tum"].depth(1)) == ("rgb/000001.png", "depth/000001.png")
    assert names["euroc"].rgb(1) == "mav0/cam0/data/1305031102175304000.png"
    assert names["tum_vi"].of(1) == names["euroc"].of(1)
    assert names["euroc"].depth(0) == "mav0/depth0/data/0000000000000000000.png"
    assert names["vslamlab"].of(1) == {"rgb_0/000001.png", "depth_0/000001.png"}
    assert names["tum"].of(0) == {"rgb/000000.png", "depth/000000.png"}
    assert names["kitti"].of(0) == {"image_2/000000.png", "depth_2/000000.png"}
    assert names["scannet"].of(1) == {"color/1.jpg", "depth/1.png"}
    assert names["nerfstudio"].of(1) == names["colmap"].of(1) == {"images/000001.png", "depth/000001.png"}
    only = OutputSpec("tum", modalities=("depth",)).format.names([0.0])
    assert only.of(0) == {"depth/000000.png"}


@pytest.mark.parametrize(
    ("stamp_s", "wanted"),
    [
        (0.0, 0),
        (1 / 30, 33_333_333),
        (0.05, 50_000_000),
        (1e-10, 0),
        (1.5e-9, 2),
        (1305031102.175304, 1_305_031_102_175_304_000),
        (1403636579.763555584, 1_403_636_579_763_555_500),  # a float64 there is known to 238 ns
        (9e9, 9 * 10**18),
        (-0.25, -250_000_000),
    ],
)
def test_nanoseconds_are_those_of_the_decimal_number(stamp_s, wanted):
    assert nanoseconds(stamp_s) == wanted
    assert nanoseconds(np.float64(stamp_s)) == wanted


def test_names_by_stamp_sort_as_time_does():
    stamps_s = [0.0, 0.999999999, 1.0, 9.5, 10.25, 99999.0, 1305031102.175304, 9e9]
    texts = [stamp_text(nanoseconds(stamp_s)) for stamp_s in stamps_s]
    assert sorted(texts) == texts
    assert {len(text) for text in texts} == {19}


@pytest.mark.parametrize(
    ("stamps_s", "words"),
    [
        ([-0.1, 0.0], "frame 0 is at -0.1 s"),
        ([0.0, 1e-10], "frame 1 has the time stamp of the frame before"),
        ([0.0, 1e10], "frame 1 is at 10000000000.0 s"),
    ],
)
def test_stamps_that_cannot_be_names(stamps_s, words):
    assert LAYOUTS["euroc"].stamps_problem(stamps_s).startswith(words)
    assert LAYOUTS["replica"].stamps_problem(stamps_s) == ""
    assert LAYOUTS["euroc"].stamps_problem([0.0, 1e-9, 2e-9]) == ""


def test_lists_of_tum_are_in_the_order_of_their_exact_stamps():
    path = Trajectory(np.stack([np.eye(4)] * 2), np.array([1e9, 1e9 + 0.05]))
    rgb = Stamps.of_ns([1_000_000_000_000_000_001, 1_000_000_000_050_000_000])
    stamps = FrameStamps(rgb, Stamps(np.array([1e9 + 0.06, 1e9 + 0.01])), rgb)
    facts = SequenceFacts(
        OutputSpec("tum").format, Intrinsics(8, 6, 4, 4, 3.5, 2.5), None, (0, 1), SensorPaths(*[path] * 4), stamps
    )
    texts = LAYOUTS["tum"].sequence_texts(facts)
    images = {name: [line for line in texts[name].splitlines() if line[0] != "#"] for name in ("rgb.txt", "depth.txt")}
    assert images == {
        "rgb.txt": ["1000000000.000000001 rgb/000000.png", "1000000000.050000000 rgb/000001.png"],
        "depth.txt": ["1000000000.010000 depth/000001.png", "1000000000.060000 depth/000000.png"],
    }


def test_the_docs_name_every_file():
    text = (ROOT / "docs/layouts.md").read_text(encoding="utf-8")
    for name, layout in LAYOUTS.items():
        assert f"## {layout.label} (`{name}`)" in text
        output = OutputSpec(name).format
        path = Trajectory(np.stack([np.eye(4)] * 2), np.array([0.0, 0.05]))
        paths = SensorPaths(path, path, path, path)
        camera, sensor = Intrinsics(8, 6, 4.0, 4.0, 3.5, 2.5), Sensor(np.eye(4))
        texts = layout.sequence_texts(SequenceFacts(output, camera, Rig(sensor, sensor), (0,), paths))
        images = [output.names([0.0]).rgb(0), output.names([0.0]).depth(0)]
        if name in ("euroc", "tum_vi"):
            images = [image.replace("0" * 19, f"{50_000_000:019d}") for image in images]
        for file in (*texts, *layout.setting_texts(camera, 1.0), *images):
            assert f"`{file}`" in text or f"/{file}`" in text, (name, file)


# --- keys that come from the registry ---


def document(**output):
    scene = {"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 2}}}
    return {"scenes": [scene], "output": output}


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ({"layout": "eurok"}, ("output.layout: ", "'eurok'", "'euroc'")),
        ({"layout": 3}, ("output.layout: ", "the number 3", ", ".join(LAYOUTS))),
        (
            {"layout": "euroc", "image": "jpg"},
            ("output.image: ", "EuRoC", "use png"),
        ),
        ({"layout": "tum", "image": "jpg"}, ("output.image: ", "TUM", "use png")),
        ({"colour": "gray"}, ("output.colour: ", "'gray'", "'grey'")),
        ({"depth_scale_per_m": 0}, ("output.depth_scale_per_m: ", " out of range")),
        ({"depth_beyond": "far"}, ("output.depth_beyond: ", "'far'", "'farthest'")),
    ],
)
def test_wrong_keys_name_what_is_right(tmp_path, output, words):
    refused(check_document, document(**output), tmp_path / "p.yaml", names=words)


def test_what_is_not_given_is_as_the_layout_has_it():
    assert OutputSpec("euroc").format.colour == "grey"
    assert OutputSpec("euroc", colour="rgb").format.colour == "rgb"
    assert OutputSpec("replica").format.image == "jpg"
    assert OutputSpec("replica", depth_scale_per_m=1000.0).format.depth_limit_m == 65.535
    rows = dict(list_keys(OutputSpec))
    assert f"one of {', '.join(LAYOUTS)}" in rows["layout"]
    assert "default jpg for replica and scannet, png for tum and " in rows["image"]
    assert "default 6553.5 for replica, 5000 for tum and euroc and tum_vi and vslamlab" in rows["depth_scale_per_m"]


@dataclass(frozen=True)
class Chosen:
    fruit: str = key("a fruit", choices={"apple": Choice("Apple", "round"), "pear": Choice("Pear", "not round")})
    many: tuple[str, ...] = key("fruits", default=(), choices={"apple": Choice("Apple", "round")})


def test_choices_of_a_key():
    assert parse(Chosen, {"fruit": "pear", "many": ["apple"]}, ConfigPath("p")) == Chosen("pear", ("apple",))
    refused(parse, Chosen, {"fruit": "peer"}, ConfigPath("p"), names=("fruit: ", "'peer'", "'pear'"))
    refused(parse, Chosen, {"fruit": "pear", "many": ["pear"]}, ConfigPath("p"), names="many.0: unknown value 'pear'")
    assert dict(list_keys(Chosen))["fruit"] == "a fruit; one of apple, pear; required"


# --- which layout a folder has ---


def test_replica_counts_by_numbers_of_any_width(tmp_path):
    for number in (9, 10):
        image(tmp_path / f"results/frame{number}.png", number)
        image(tmp_path / f"results/depth{number}.png", 1000, (6, 8), np.uint16)
    (tmp_path / "traj.txt").write_text(f"{REPLICA_POSE.format(0)}\n{REPLICA_POSE.format(1)}\n")
    found = find_sequence(tmp_path)
    assert [path.name for path in found.rgb_files] == ["frame9.png", "frame10.png"]
    assert [path.name for path in found.depth_files] == ["depth9.png", "depth10.png"]


def test_none_or_several_layouts_are_one_line(tmp_path):
    refused(
        find_sequence,
        tmp_path,
        names=(
            "is no sequence; ",
            "Replica or TUM or EuRoC ASL or TUM-VI or VSLAM-LAB or ",
            " or Nerfstudio",
        ),
    )
    WRITTEN["replica"](tmp_path)
    WRITTEN["tum"](tmp_path)
    refused(find_sequence, tmp_path, names=("Replica and of TUM", "leave those of one"))


# --- EuRoC, as its own files are ---


def quat_matrix(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_euroc_poses_are_the_cameras(tmp_path):
    write_euroc(tmp_path)
    found = find_sequence(tmp_path)
    assert found.trajectory.stamps_s.tolist() == [1403636579.76, 1403636579.81]
    body_from_camera = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])
    for k, (position, quat) in enumerate([((1, 2, 3), (1, 0, 0, 0)), ((4, 5, 6), (0.5, 0.5, -0.5, 0.5))]):
        body = np.eye(4)
        body[:3, :3], body[:3, 3] = quat_matrix(*quat), position
        assert np.allclose(found.trajectory.c2w[k], body @ body_from_camera, atol=1e-12)
    camera = found.camera
    assert (camera.width_px, camera.height_px) == (8, 6)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (458.654, 457.296, 3.5, 2.5)
    frame = found.frame(1)
    assert frame.rgb.shape == (6, 8, 3)
    assert (frame.rgb == 110).all()
    assert np.allclose(frame.depth_m, 2.5)
    assert frame.stored_rgb == ("png", "grey")


def test_euroc_in_colour_and_with_17_columns(tmp_path):
    write_euroc(tmp_path, colour=True, columns=17, line_end="\r\n")
    found = find_sequence(tmp_path)
    assert len(found.trajectory) == 2
    assert found.frame(0).rgb[0, 0].tolist() == [30, 20, 10]  # RGB of what OpenCV wrote as 10, 20, 30
    assert found.frame(0).stored_rgb == ("png", "rgb")
    assert found.rgb_files[1].name == "1403636579810000000.png"


def test_euroc_pairs_by_stamp_within_the_tolerance(tmp_path):
    write_euroc(tmp_path, depth_late_ns=15_000_000)
    assert len(find_sequence(tmp_path).trajectory) == 2
    write_euroc(tmp_path / "late", depth_late_ns=21_000_000)
    refused(find_sequence, tmp_path / "late", names="within 0.02 s")


def edit(name, old, new):
    def change(folder):
        path = folder / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return change


CAM, DEPTH, STATE = "mav0/cam0", "mav0/depth0", "mav0/state_groundtruth_estimate0/data.csv"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder: (folder / f"{DEPTH}/data.csv").unlink(), "depth0/data.csv: cannot be read"),
        (lambda folder: (folder / f"{CAM}/data.csv").unlink(), "cam0/data.csv: is not there: no colour"),
        (lambda folder: (folder / f"{CAM}/sensor.yaml").unlink(), "cam0/sensor.yaml: cannot be read"),
        (lambda folder: (folder / STATE).unlink(), "state_groundtruth_estimate0/data.csv: does not exist"),
        (edit(f"{CAM}/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[-0.28, 0.07, 0.0]"), "holds 3 coefficients, but radial"),
        (edit(f"{CAM}/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[.nan, 0.0, 0.0, 0.0]"), "has to be a list of finite"),
        (edit(f"{DEPTH}/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[0.1, 0.0, 0.0, 0.0]"), "is not that of mav0/cam0"),
        (edit(f"{CAM}/sensor.yaml", "pinhole", "omni"), "camera_model: is 'omni'"),
        (edit(f"{CAM}/sensor.yaml", "[8, 6]", "[8]"), "resolution: has to be 2 numbers"),
        (edit(f"{CAM}/sensor.yaml", "T_BS", "T_SB"), "T_BS: has to be 16 numbers"),
        (edit(f"{CAM}/sensor.yaml", "1.0, 0.0, 0.0, 0.2", "1.1, 0.0, 0.0, 0.2"), "T_BS: is no rigid pose"),
        (edit(f"{CAM}/sensor.yaml", "1.0, 0.0, 0.0, 0.2", "1e300, 0.0, 0.0, 1e300"), "T_BS: is no rigid pose"),
        (edit(f"{CAM}/sensor.yaml", "data: [", "data: [["), "is not valid YAML"),
        (
            lambda folder: (
                edit(f"{CAM}/sensor.yaml", "intrinsics:", "other:")(folder),
                edit(f"{DEPTH}/sensor.yaml", "0.0, -1.0, 0.0, 0.1", "0.0, -1.0, 0.0, 0.2")(folder),
            ),
            f"{CAM}/sensor.yaml: says no intrinsics, but depth has a pose of its own",
        ),
        (edit(f"{DEPTH}/sensor.yaml", "depth_scale_per_m", "scale"), "holds no depth_scale_per_m; add it"),
        (edit(f"{DEPTH}/sensor.yaml", "2000.0", "-1"), "depth_scale_per_m: is -1, but has to be a number above 0"),
        (edit(STATE, "1.0,2.0", "1.0,x"), "line 2: 'x' is not a number"),
        (edit(STATE, "1.0,2.0", "1.0,nan"), "line 2: holds nan"),
        (edit(STATE, "1.0,2.0", "1.0"), "data.csv: line 2: "),
        (edit(STATE, "0.5,0.5,-0.5,0.5", "0.9,0.5,-0.5,0.5"), "line 3: the quaternion has length 1.24"),
        (edit(STATE, "1403636579810000000", "1403636579"), "line 3: the time stamp 1403636579 does not come after"),
        (edit(STATE, "1403636579810000000", "1.4e18"), "line 3: '1.4e18' is no time in whole nanoseconds"),
        (edit(f"{CAM}/data.csv", ",1403636579810000000.png", ""), "line 3: is no time stamp and file name"),
        (lambda folder: (folder / f"{CAM}/data.csv").write_text("#timestamp [ns],filename\n"), "lists no image"),
    ],
)
def test_a_broken_euroc_sequence_is_one_line(tmp_path, change, words):
    write_euroc(tmp_path)
    change(tmp_path)
    refused(find_sequence, tmp_path, names=words)


def test_opencvs_first_line_of_yaml_is_skipped(tmp_path):
    write_euroc(tmp_path)
    path = tmp_path / CAM / "sensor.yaml"
    path.write_text("%YAML:1.0\n" + path.read_text())
    assert find_sequence(tmp_path).camera.fx_px == 458.654
