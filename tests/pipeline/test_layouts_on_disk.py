# SPDX-License-Identifier: GPL-3.0-or-later
"""What each layout writes, checked by parsers of the tests' own; and written, read and written again."""

import csv
import hashlib
import json
import sys
import threading

import cv2
import fake_session
import numpy as np
import pytest
import yaml
from worlds import content, path_poses, write_world

from noisy_world.core.datasets.layouts import LAYOUTS, find_sequence
from noisy_world.core.errors import InputError, InterruptedRunError
from noisy_world.core.planning.plan import load_trajectory, make_plan
from noisy_world.core.presets.preset import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.perturbations import registry
from noisy_world.pipeline import Run

SIZE = (8, 6)
COUNT = 4
SHAKY = {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]}
RIG = {
    "rgb": {"translation_m": [0.1, 0.0, 0.2], "rotation_euler_deg": [-90.0, 0.0, -90.0]},
    "depth": {"translation_m": [0.1, 0.05, 0.2], "rotation_euler_deg": [-90.0, 10.0, -90.0]},
}


@pytest.fixture(autouse=True)
def _no_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.blender.session", fake_session)
    fake_session.Session.rendered.clear()


def run(preset, out, *, frames=None, overrides=(), stop=None, overwrite=False):
    plan = make_plan(read_preset(preset, overrides), frames, registry())
    make = Run(plan, out, progress=PlainProgress(sys.stderr), stop=stop or threading.Event(), overwrite=overwrite)
    return make()


def world(folder, layout, *, frames=COUNT, output=None, **keys):
    return write_world(folder, frames=frames, size=SIZE, output={"layout": layout, **(output or {})}, **keys)


def stored(folder, source, **output):
    """Write a preset whose scene is a sequence that exists."""
    camera = {"width": 8, "height": 6, "fx": 4.0, "fy": 4.0, "cx": 3.5, "cy": 2.5}
    scene = {"name": "box", "sequence": str(source)}
    preset = {"seed": 3, "scenes": [scene], "camera": camera, "render": {"backend": "reference"}, "output": output}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "stored.json"
    path.write_text(json.dumps(preset))
    return path


# --- parsers of our own ---


def rows_of(path):
    """The rows of a data.csv without its header, as evo and others read them; no line may end in CR."""
    text = path.read_bytes().decode("ascii")
    assert "\r" not in text
    assert text.endswith("\n")
    header, *rows = csv.reader(text.splitlines())
    assert header[0].startswith("#timestamp")
    return rows


def matrix_of(row):
    """The pose (4, 4) of a row of ground truth, its quaternion with w first, by hand."""
    assert len(row) == 8
    x, y, z, qw, qx, qy, qz = map(float, row[1:])
    assert abs(qw * qw + qx * qx + qy * qy + qz * qz - 1) < 1e-9
    return np.array(
        [
            [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw), x],
            [2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw), y],
            [2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy), z],
            [0, 0, 0, 1],
        ]
    )


def states(folder, name="state_groundtruth_estimate0"):
    rows = rows_of(folder / "mav0" / name / "data.csv")
    return [int(row[0]) for row in rows], np.array([matrix_of(row) for row in rows])


def replica_poses(path):
    return np.loadtxt(path).reshape(-1, 4, 4)


def extrinsics(path):
    sensor = yaml.safe_load(path.read_text())
    assert (sensor["T_BS"]["rows"], sensor["T_BS"]["cols"]) == (4, 4)
    return np.array(sensor["T_BS"]["data"]).reshape(4, 4)


def read(path):
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found


def names_in(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


# --- EuRoC ---


def test_every_file_of_a_euroc_sequence(tmp_path):
    run(world(tmp_path / "w", "euroc"), tmp_path / "out")
    run(world(tmp_path / "r", "replica", output={"image": "png"}), tmp_path / "replica")
    folder, other = tmp_path / "out/clean/box", tmp_path / "replica/clean/box"
    stems = [f"{k * 50_000_000:019d}" for k in range(COUNT)]
    images = {f"mav0/{sensor}/data/{stem}.png" for sensor in ("cam0", "depth0") for stem in stems}
    described = {
        f"mav0/{place}/{name}"
        for place in ("cam0", "depth0", "state_groundtruth_estimate0")
        for name in ("data.csv", "sensor.yaml")
    }
    assert names_in(folder) == images | described | {"mav0/body.yaml", "mav0/cam0/timestamps.txt", "frames.jsonl"}
    assert [path.name for path in (tmp_path / "out/clean").iterdir()] == ["box"]  # no cam_params.json
    for sensor in ("cam0", "depth0"):
        listed = rows_of(folder / "mav0" / sensor / "data.csv")
        assert listed == [[stem, f"{stem}.png"] for stem in stems]
        assert sorted(name for _, name in listed) == [name for _, name in listed]
        about = yaml.safe_load((folder / "mav0" / sensor / "sensor.yaml").read_text())
        assert about["rate_hz"] == 20
        assert about["resolution"] == [8, 6]
        assert about["camera_model"] == "pinhole"
        assert about["intrinsics"] == [4.0, 4.0, 3.5, 2.5]
        assert about["distortion_coefficients"] == [0.0] * 4
        assert np.array_equal(extrinsics(folder / "mav0" / sensor / "sensor.yaml"), np.eye(4))
    assert yaml.safe_load((folder / "mav0/depth0/sensor.yaml").read_text())["depth_scale_per_m"] == 5000.0
    # ORB-SLAM3 takes a line of this file, with its end cut at LF alone, as an image's name.
    times = (folder / "mav0/cam0/timestamps.txt").read_bytes().decode().split("\n")
    assert times == [*stems, ""]
    assert isinstance(yaml.safe_load((folder / "mav0/body.yaml").read_text()), dict)
    stamps_ns, poses = states(folder)
    assert stamps_ns == [k * 50_000_000 for k in range(COUNT)]
    assert np.allclose(poses, replica_poses(other / "traj.txt"), atol=1e-12)
    assert np.allclose(poses, path_poses(COUNT), atol=1e-12)
    for k, stem in enumerate(stems):
        rgb = 255 * np.clip(fake_rgb(k), 0, 1).astype(float)
        grey = read(folder / f"mav0/cam0/data/{stem}.png")
        assert grey.shape == (6, 8)
        assert grey.dtype == np.uint8
        assert np.abs(grey - rgb @ [0.299, 0.587, 0.114]).max() <= 0.5 + 1e-4
        depth = read(folder / f"mav0/depth0/data/{stem}.png")
        assert depth.dtype == np.uint16
        assert np.abs(depth / 5000 - fake_depth_m(k)).max() <= 0.5 / 5000 + 1e-6


def fake_rgb(frame):
    ramp = np.linspace(0, 1, 48, dtype=np.float32).reshape(6, 8)
    return np.stack([ramp, 1 - ramp, np.full_like(ramp, frame / 255)], axis=-1)


def fake_depth_m(frame):
    return 1 + np.linspace(0, 1, 48).reshape(6, 8) + frame


def test_euroc_in_colour(tmp_path):
    run(world(tmp_path / "w", "euroc", output={"colour": "rgb"}), tmp_path / "out")
    pixels = read(tmp_path / f"out/clean/box/mav0/cam0/data/{50_000_000:019d}.png")
    assert pixels.shape == (6, 8, 3)
    assert np.abs(pixels[..., ::-1] - 255 * fake_rgb(1)).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("image", ["jpg", "png"])
def test_grey_where_a_preset_asks_for_it(tmp_path, image):
    settings = [{"name": "clean"}, {"name": "bright", "perturb": [{"brightness": {"severity": 2}}]}]
    preset = world(tmp_path / "w", "replica", output={"image": image, "colour": "grey"}, settings=settings)
    run(preset, tmp_path / "out")
    for setting in ("clean", "bright"):
        assert read(tmp_path / f"out/{setting}/box/results/frame000001.{image}").shape == (6, 8)


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_euroc_with_one_modality_has_no_trace_of_the_other(tmp_path, modality):
    preset = world(tmp_path / "w", "euroc", output={"modalities": [modality], "overview": True})
    run(preset, tmp_path / "out")
    here, other = ("cam0", "depth0") if modality == "rgb" else ("depth0", "cam0")
    folder = tmp_path / "out/clean/box"
    assert len(rows_of(folder / "mav0" / here / "data.csv")) == COUNT
    assert not (folder / "mav0" / other).exists()
    assert (folder / "mav0/cam0/timestamps.txt").exists() == (modality == "rgb")
    assert (tmp_path / "out/overview.png").stat().st_size > 500
    with pytest.raises(InputError, match=f"{other}/data.csv: is not there"):
        find_sequence(folder)


def test_a_robot_is_the_body(tmp_path):
    keys = {"rig": RIG, "settings": [{"name": "clean"}, SHAKY]}
    run(world(tmp_path / "w", "euroc", **keys), tmp_path / "out")
    run(world(tmp_path / "r", "replica", **keys), tmp_path / "replica")
    for setting in ("clean", "shaky"):
        folder, other = tmp_path / f"out/{setting}/box", tmp_path / f"replica/{setting}/box"
        _, body = states(folder)
        assert np.allclose(body, replica_poses(other / "traj_robot.txt"), atol=1e-12)
        for sensor, name in (("cam0", "traj.txt"), ("depth0", "traj_depth.txt")):
            in_body = extrinsics(folder / "mav0" / sensor / "sensor.yaml")
            assert np.allclose(body @ in_body, replica_poses(other / name), atol=1e-12)
        assert not np.allclose(extrinsics(folder / "mav0/cam0/sensor.yaml"), np.eye(4), atol=0.05)
    stamps_ns, nominal = states(tmp_path / "out/shaky/box", "state_nominal0")
    clean_ns, clean = states(tmp_path / "out/clean/box")
    assert stamps_ns == clean_ns
    assert np.allclose(nominal, clean, atol=1e-12)
    with pytest.raises(InputError, match="T_BS is not that of mav0/cam0"):
        find_sequence(tmp_path / "out/clean/box")


def test_the_nominal_path_has_a_file_of_its_own(tmp_path):
    run(world(tmp_path / "w", "euroc", settings=[{"name": "clean"}, SHAKY]), tmp_path / "out")
    _, clean = states(tmp_path / "out/clean/box")
    _, true = states(tmp_path / "out/shaky/box")
    _, nominal = states(tmp_path / "out/shaky/box", "state_nominal0")
    assert np.allclose(nominal, clean, atol=1e-15)
    assert (np.abs(true - nominal).max(axis=(1, 2)) > 1e-4).all()
    assert not (tmp_path / "out/clean/box/mav0/state_nominal0").exists()


def write_tum_path(folder, stamps):
    rows = [f"{stamp} {0.1 * k} 0.0 1.2 0.0 0.0 0.0 1.0" for k, stamp in enumerate(stamps)]
    (folder / "path.txt").write_text("\n".join(rows) + "\n")
    return "scenes.0.trajectory=path.txt"


def test_stamps_of_a_real_clock_name_the_files(tmp_path):
    preset = world(tmp_path / "w", "euroc")
    override = write_tum_path(tmp_path / "w", ["1305031102.175304", "1305031102.211214", "1305031102.243211"])
    run(preset, tmp_path / "out", overrides=[override])
    folder = tmp_path / "out/clean/box"
    wanted = ["1305031102175304000", "1305031102211214000", "1305031102243211000"]
    assert sorted(path.stem for path in (folder / "mav0/cam0/data").iterdir()) == wanted
    assert [row[0] for row in rows_of(folder / "mav0/state_groundtruth_estimate0/data.csv")] == wanted
    records = [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]
    assert [record["time_s"] for record in records] == [1305031102.175304, 1305031102.211214, 1305031102.243211]
    assert find_sequence(folder).trajectory.stamps_s.tolist() == [record["time_s"] for record in records]


@pytest.mark.parametrize(
    ("stamps", "words"), [(["-1.0", "0.0"], "frame 0 is at -1.0 s"), (["1.0", "1.0000000001"], "frame 1 has the time")]
)
def test_stamps_that_cannot_be_names_are_refused_before_anything_is_made(tmp_path, stamps, words):
    preset = world(tmp_path / "w", "euroc")
    override = write_tum_path(tmp_path / "w", stamps)
    with pytest.raises(InputError, match=words) as error:
        run(preset, tmp_path / "out", overrides=[override])
    assert "scenes.0" in str(error.value)
    assert "another output.layout" in str(error.value)
    assert not (tmp_path / "out").exists()
    run(preset, tmp_path / "out", overrides=[override, "output.layout=tum"])


@pytest.mark.parametrize(
    "trajectory",
    [
        "{handheld: {frames: 12, rate_hz: 30}}",
        "{handheld: {frames: 12}, start: 1, stop: 11, every: 3}",
        "{handheld: {frames: 12}, resample_hz: 7}",
        "{file: traj.txt, rate_hz: 12.5, start: 1}",
    ],
)
def test_stamps_are_known_before_the_path_is(tmp_path, trajectory):
    preset = world(tmp_path / "w", "euroc")
    plan = make_plan(read_preset(preset, [f"scenes.0.trajectory={trajectory}"]), None, registry())
    scene = plan.renders[0].scene
    assert np.array_equal(scene.stamps_s, load_trajectory(plan, scene).stamps_s)
    assert scene.frame_count == len(scene.stamps_s) == len(plan.sequences[0].frames)


def test_desynchronised_and_faster_sequences_keep_the_cameras_stamps(tmp_path):
    settings = [
        {"name": "clean"},
        {"name": "late", "perturb": [{"desync": {"offset": 1}}]},
        {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    ]
    run(world(tmp_path / "w", "euroc", frames=5, settings=settings), tmp_path / "out")

    def path(setting, sensor, k):
        return tmp_path / f"out/{setting}/box/mav0/{sensor}/data/{k * 50_000_000:019d}.png"

    for k in range(5):
        assert path("late", "cam0", k).samefile(path("clean", "cam0", k))
        assert path("late", "depth0", k).samefile(path("clean", "depth0", min(k + 1, 4)))
    assert sorted(item.name for item in path("fast", "cam0", 0).parent.iterdir()) == [
        path("fast", "cam0", k).name for k in range(3)
    ]
    for k in range(3):
        for sensor in ("cam0", "depth0"):
            assert path("fast", sensor, k).samefile(path("clean", sensor, 2 * k))
    _, clean = states(tmp_path / "out/clean/box")
    stamps_ns, fast = states(tmp_path / "out/fast/box")
    assert stamps_ns == [0, 50_000_000, 100_000_000]
    assert np.allclose(fast, clean[::2], atol=1e-15)
    assert yaml.safe_load((tmp_path / "out/fast/box/mav0/cam0/sensor.yaml").read_text())["rate_hz"] == 20


def test_euroc_parts_make_the_whole_and_a_stopped_run_goes_on(tmp_path):
    preset = world(tmp_path / "w", "euroc", settings=[{"name": "clean"}, {"name": "same"}])
    run(preset, tmp_path / "whole")
    whole = content(tmp_path / "whole")
    run(preset, tmp_path / "parts", frames=slice(2, None))
    folder = tmp_path / "parts/clean/box"
    assert [int(row[0]) for row in rows_of(folder / "mav0/cam0/data.csv")] == [100_000_000, 150_000_000]
    assert states(folder)[0] == [100_000_000, 150_000_000]
    run(preset, tmp_path / "parts", frames=slice(0, 2))
    assert content(tmp_path / "parts") == whole

    stop = threading.Event()
    render = fake_session.Session.render

    def stopping(self, frame):
        if frame == 1:
            stop.set()
        return render(self, frame)

    fake_session.Session.render = stopping
    try:
        with pytest.raises(InterruptedRunError):
            run(preset, tmp_path / "stopped", stop=stop)
    finally:
        fake_session.Session.render = render
    fake_session.Session.rendered.clear()
    run(preset, tmp_path / "stopped")
    assert 0 < len(fake_session.Session.rendered) < COUNT
    assert content(tmp_path / "stopped") == whole
    lost = tmp_path / f"stopped/same/box/mav0/depth0/data/{50_000_000:019d}.png"
    lost.unlink()
    fake_session.Session.rendered.clear()
    run(preset, tmp_path / "stopped")
    assert fake_session.Session.rendered == [1]
    assert content(tmp_path / "stopped") == whole


# --- the keys ---


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_the_depth_scale_is_told_where_readers_look(tmp_path, layout):
    run(world(tmp_path / "w", layout, output={"depth_scale_per_m": 1000}), tmp_path / "out")
    folder = tmp_path / "out/clean/box"
    found = find_sequence(folder)
    assert found.depth_scale_per_m == 1000
    assert np.array_equal(read(found.depth_files[2]), np.rint(1000 * fake_depth_m(2)))
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["depth_scale_per_m"] == 1000
    assert manifest["depth_limit_m"] == 65.535
    if layout != "euroc":
        camera = json.loads((tmp_path / "out/clean/cam_params.json").read_text())["camera"]
        assert camera["scale"] == 1000


@pytest.mark.parametrize(("beyond", "step"), [("void", 0), ("farthest", 65535)])
def test_what_lies_beyond_16_bits(tmp_path, beyond, step):
    output = {"image": "png", "depth_scale_per_m": 20000, "depth_beyond": beyond}  # up to 3.28 m
    settings = [{"name": "clean"}, {"name": "eroded", "perturb": [{"depth_edge_erosion": {"severity": 1}}]}]
    run(world(tmp_path / "w", "replica", output=output, settings=settings), tmp_path / "out")
    for setting in ("clean", "eroded"):
        depth = read(tmp_path / f"out/{setting}/box/results/depth000002.png")
        far = fake_depth_m(2) > 65535 / 20000
        assert 0.1 < far.mean() < 0.9
        assert (depth[far] == step).all()
        assert depth[0, 0] == 60000
    assert json.loads((tmp_path / "out/manifest.json").read_text())["depth_beyond"] == beyond


# --- read and written again ---


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_what_is_written_and_read_is_written_the_same_again(tmp_path, layout, monkeypatch):
    run(world(tmp_path / "w", layout, output={"colour": "rgb", "image": "png"}), tmp_path / "out")
    monkeypatch.setitem(sys.modules, "noisy_world.blender.session", None)
    source = tmp_path / "out/clean/box"
    run(stored(tmp_path / "p", source, layout=layout, colour="rgb", image="png"), tmp_path / "again")
    names = names_in(source)
    assert names_in(tmp_path / "again/clean/box") == names
    for name in names:
        same = (source / name).read_bytes() == (tmp_path / "again/clean/box" / name).read_bytes()
        if name.endswith("state_groundtruth_estimate0/data.csv"):  # a rotation by way of a quaternion and back
            poses = [states(place)[1] for place in (source, tmp_path / "again/clean/box")]
            assert np.allclose(*poses, atol=1e-12)
        elif "groundtruth" in name and name.endswith(".txt"):
            tables = [np.loadtxt(place / name) for place in (source, tmp_path / "again/clean/box")]
            assert np.allclose(*tables, atol=1e-12)
        else:
            assert same, name


def test_from_tum_to_euroc_and_on_to_replica(tmp_path):
    preset = world(tmp_path / "w", "tum", settings=[{"name": "clean"}])
    override = write_tum_path(tmp_path / "w", ["1305031102.175304", "1305031102.211214", "1305031102.243211"])
    run(preset, tmp_path / "tum", overrides=[override])
    tum = tmp_path / "tum/clean/box"
    run(stored(tmp_path / "p", tum, layout="euroc"), tmp_path / "euroc")
    euroc = tmp_path / "euroc/clean/box"
    listed = [line.split() for line in (tum / "rgb.txt").read_text().splitlines() if not line.startswith("#")]
    for number, (stamp, name) in enumerate(listed):
        seconds, micro = stamp.split(".")
        stem = f"{int(seconds) * 10**9 + int(micro) * 1000:019d}"
        grey = read(euroc / f"mav0/cam0/data/{stem}.png")
        bgr = read(tum / name).astype(int)
        by_hand = (114 * bgr[..., 0] + 587 * bgr[..., 1] + 299 * bgr[..., 2]) / 1000
        assert np.abs(grey - by_hand).max() <= 0.5
        # The scale is TUM's own, so the very files are taken over.
        assert (euroc / f"mav0/depth0/data/{stem}.png").samefile(tum / f"depth/{number:06d}.png")
    truth = np.loadtxt(tum / "groundtruth.txt")
    stamps_ns, poses = states(euroc)
    assert stamps_ns == [1305031102175304000, 1305031102211214000, 1305031102243211000]
    assert np.allclose(poses[:, :3, 3], truth[:, 1:4], atol=1e-12)
    # Grey comes back as colour with three channels alike, unless grey is asked for: then it is the file itself.
    run(stored(tmp_path / "q", euroc, layout="replica", image="png"), tmp_path / "replica")
    run(stored(tmp_path / "g", euroc, layout="replica", image="png", colour="grey"), tmp_path / "grey")
    for k, stamp_ns in enumerate(stamps_ns):
        there = read(euroc / f"mav0/cam0/data/{stamp_ns}.png")
        back = read(tmp_path / f"replica/clean/box/results/frame{k:06d}.png")
        assert np.array_equal(back, np.repeat(there[..., None], 3, axis=2))
        taken = tmp_path / f"grey/clean/box/results/frame{k:06d}.png"
        assert taken.samefile(euroc / f"mav0/cam0/data/{stamp_ns}.png")
        depth = read(tmp_path / f"replica/clean/box/results/depth{k:06d}.png")
        assert np.abs(depth / 6553.5 - read(euroc / f"mav0/depth0/data/{stamp_ns}.png") / 5000).max() <= 0.5 / 6553.5


def test_intrinsics_that_the_sequence_tells_have_to_be_the_presets(tmp_path):
    run(world(tmp_path / "w", "euroc"), tmp_path / "out")
    preset = stored(tmp_path / "p", tmp_path / "out/clean/box")
    run(preset, tmp_path / "same")
    with pytest.raises(InputError, match=r"its camera has fx 4, fy 4, cx 3\.5, cy 2\.5; say so in camera"):
        run(preset, tmp_path / "other", overrides=["camera.fx=4.5"])


# --- removal ---

MINE = ("mav0/cam0/data/notes.txt", "mav0/imu0/data.csv", "results/mine.png", "rgb/mine.png", "mine.txt")


@pytest.mark.parametrize("new", list(LAYOUTS))
@pytest.mark.parametrize("old", list(LAYOUTS))
def test_overwriting_removes_the_old_layouts_files_and_no_other(tmp_path, old, new):
    keys = {"rig": RIG, "settings": [{"name": "clean"}, SHAKY]}
    run(world(tmp_path / "old", old, frames=5, **keys), tmp_path / "out")
    assert names_in(tmp_path / "out")
    for name in MINE:
        path = tmp_path / "out/shaky/box" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    preset = world(tmp_path / "new", new)
    run(preset, tmp_path / "out", overwrite=True)
    run(preset, tmp_path / "alone")
    assert content(tmp_path / "out").items() - content(tmp_path / "alone").items() == {
        (f"shaky/box/{name}", hashlib.sha256(b"mine").hexdigest()) for name in MINE
    }
    folders = {path.relative_to(tmp_path / "out/clean").as_posix() for path in (tmp_path / "out/clean").rglob("*")}
    alone = {path.relative_to(tmp_path / "alone/clean").as_posix() for path in (tmp_path / "alone/clean").rglob("*")}
    assert folders == alone  # empty folders of the old layout are gone too
