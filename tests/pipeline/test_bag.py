# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world bag`: bags that rosbags reads back, with what the sequence holds, or over the images of another."""

import json
import struct
from decimal import Decimal

import cv2
import numpy as np
import pytest
import yaml
from cases import cases
from inertial_paths import GRAVITY_M_S2
from made_bags import K, LATE_NS, SIZE, START_NS, STEP_NS, compressed_depth, depth_mm, walk
from runs import planned, run
from written import RIG, rows_of, world

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.images.pixels import as_bytes
from noisy_world.layouts import LAYOUTS, find_sequence
from noisy_world.layouts.described import BagTopics
from noisy_world.layouts.bag_recording import read_bag_sequence

pytestmark = pytest.mark.usefixtures("no_blender")

ENTRY = Entry("noisy-world bag", ("noisy-world", "bag"))
IMU = {"translation_m": [0.02, -0.03, 0.05], "device": "adis16448", "time_offset_s": 0.02}


def sequence(folder, imu=True, **output):
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
    rig = {**RIG, **({"imu": IMU} if imu else {})}
    run(world(folder / "w", "euroc", frames=6, rig=rig, scenes=scenes, output=output), folder / "out")
    return folder / "out/clean/box"


def messages(path):
    reading = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    found = {}
    with reading.AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp_ns, message))
    return found


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@cases("storage", ["mcap", "sqlite3"])
def test_a_bag_holds_the_sequence(tmp_path, storage):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder = sequence(tmp_path / storage)
    out = tmp_path / storage / "bag"
    assert command.run("bag", [str(folder), str(out), "--storage", storage], ENTRY) == 0
    found, stored = messages(out), find_sequence(folder)
    assert (
        yaml.safe_load((out / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["storage_identifier"]
        == storage
    )
    images = found["/cam0/image_raw"]
    assert [stamp_of(message) for _, message in images] == list(stored.stamps.rgb.ns)
    depths = found["/depth0/image_raw"]
    for number, ((_, image), (_, depth)) in enumerate(zip(images, depths, strict=True)):
        assert image.encoding == "mono8"
        frame = stored.frame(number)
        np.testing.assert_array_equal(image.data.reshape(image.height, image.width), np.asarray(frame.rgb)[..., 0])
        assert depth.encoding == "32FC1"
        values = np.frombuffer(depth.data.tobytes(), np.float32).reshape(depth.height, depth.width)
        np.testing.assert_array_equal(values, frame.depth_m)
    camera = found["/cam0/camera_info"][0][1]
    assert camera.k.tolist() == [4.0, 0, 3.5, 0, 4.0, 2.5, 0, 0, 1]
    rows = rows_of(folder / "mav0/imu0/data.csv")
    samples = found["/imu0"]
    assert [stamp_of(message) for _, message in samples] == [int(row[0]) for row in rows]
    first = samples[0][1]
    force = [first.linear_acceleration.x, first.linear_acceleration.y, first.linear_acceleration.z]
    assert force == [float(cell) for cell in rows[0][4:]]
    assert np.linalg.norm(force) > 0.5 * np.linalg.norm(GRAVITY_M_S2)
    times = [stamp_ns for topic in found.values() for stamp_ns, _ in topic]
    assert min(times) == 0
    static = {item.child_frame_id: item for item in found["/tf_static"][0][1].transforms}
    assert static.keys() == {"cam0", "depth0"}
    assert len(found["/tf"]) == len(rows_of(folder / "mav0/state_groundtruth_estimate0/data.csv"))
    # The colour camera's first pose, by both transforms.
    world_from_body, body_from_cam = (
        matrix(item.transform) for item in (found["/tf"][0][1].transforms[0], static["cam0"])
    )
    np.testing.assert_allclose(world_from_body @ body_from_cam, stored.trajectory.c2w[0], atol=1e-9)


def matrix(transform):
    x, y, z, w = (getattr(transform.rotation, axis) for axis in "xyzw")
    moved = [getattr(transform.translation, axis) for axis in "xyz"]
    turned = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.block([[np.array(turned), np.array(moved)[:, None]], [np.array([[0, 0, 0, 1.0]])]])


def test_without_an_imu_and_in_colour(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder = sequence(tmp_path, imu=False, colour="rgb")
    assert command.run("bag", [str(folder), str(tmp_path / "bag")], ENTRY) == 0
    found = messages(tmp_path / "bag")
    assert "/imu0" not in found
    assert found["/cam0/image_raw"][0][1].encoding == "rgb8"


def made(folder, layout, **keys):
    """Make a dataset of a box in a layout; return its sequence's folder."""
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
    run(world(folder / "w", layout, frames=4, scenes=scenes, **keys), folder / "out")
    return folder / "out/clean/box"


FORMS = (("b.bag", None), ("b.mcap", None), ("b.db3", None), ("b", "mcap"), ("b", "sqlite3"))


@cases("name, storage", FORMS)
def test_what_is_written_is_read_back(tmp_path, name, storage):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    for layout in ("euroc", "replica") if name != "b.bag" else LAYOUTS:
        place = tmp_path / f"{name}-{storage}-{layout}"
        rig = {**RIG, "imu": IMU} if layout in ("euroc", "tum", "tum_vi", "vslamlab") else None
        folder = made(place, layout, **({"rig": rig} if rig else {}))
        out = place / name
        words = [str(folder), "--out", str(out), *(["--storage", storage] if storage else [])]
        assert command.run("bag", words, ENTRY) == 0
        was, found = find_sequence(folder), read_bag_sequence(out, BagTopics())
        assert found.stamps.rgb.ns == was.stamps.rgb.ns, layout
        assert found.stamps.depth.ns == was.stamps.depth.ns
        np.testing.assert_allclose(found.trajectory.c2w, was.trajectory.c2w, rtol=0, atol=1e-9)
        for number in range(len(was.stamps)):
            one, other = was.frame(number), found.frame(number)
            np.testing.assert_array_equal(other.rgb, as_bytes(one.rgb))
            steps = [np.rint(frame.depth_m.astype(np.float64) * was.depth_scale_per_m) for frame in (one, other)]
            np.testing.assert_array_equal(*steps)
        assert (found.imu is None) == (rig is None), layout
        if rig is not None:
            assert samples_of(found) == samples_of_files(folder), layout


def samples_of(stored):
    """Return the stamps and the numbers of an IMU's samples."""
    samples = stored.imu.samples
    values = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1).tolist()
    return [(stamp_ns, *row) for stamp_ns, row in zip(samples.stamps_ns.tolist(), values, strict=True)]


def samples_of_files(folder):
    """Return the same of a sequence's text, whichever it is."""
    names = ("mav0/imu0/data.csv", "imu.csv", "imu_0.csv")
    found = [folder / name for name in names if (folder / name).is_file()]
    assert found, list(folder.rglob("*"))
    file = found[0]
    rows = [line.split(",") for line in file.read_text().splitlines() if line[0].isdigit()]
    return [(int(row[0]), *map(float, row[1:])) for row in rows]


def test_a_pattern_names_several_bags(tmp_path):
    for name in ("one", "two"):
        walk(tmp_path, "ros1", frames=2).rename(tmp_path / f"walk_{name}.bag")
    (tmp_path / "walk_other.txt").write_text("no bag")
    scene = {"sequence": "walk_*"}
    (tmp_path / "p.json").write_text(json.dumps({"scenes": [scene], "output": {"layout": "tum"}}))
    assert [scene.name for scene in planned(tmp_path / "p.json").scenes] == ["one.bag", "two.bag"]


# --- over a bag ---


def texts(path):
    """Return every message of a bag as it is stored, but for images: how its topic is sent, time and bytes."""
    with reader_of(path) as reader:
        found = [
            (item.topic, item.msgtype, repr((item.msgdef, item.digest, item.ext)), stamp_ns, bytes(raw))
            for item, stamp_ns, raw in reader.messages()
        ]
    assert any("transient_local" in item[2].lower() or "/robot" in item[2] for item in found)
    return sorted(item for item in found if "image_raw" not in item[0])


def reader_of(path):
    if path.suffix == ".bag":
        return pytest.importorskip("rosbags.rosbag1").Reader(path)
    return pytest.importorskip("rosbags.rosbag2").Reader(path)


def perturbed(folder, source, layout="tum"):
    """Make a dataset of a bag, brighter; return its sequence's folder."""
    preset = {
        "seed": 3,
        "scenes": [{"name": "walk", "sequence": source if isinstance(source, dict) else str(source)}],
        "settings": [{"name": "bright", "perturb": [{"brightness": {"offset": 0.25}}]}],
        "render": {"backend": "reference"},
        "output": {"layout": layout, "image": "png"},
    }
    folder.mkdir()
    (folder / "p.json").write_text(json.dumps(preset))
    run(folder / "p.json", folder / "out")
    return folder / "out/bright/walk"


@cases(
    "form, compression",
    [("ros1", None), ("ros1", "lz4"), ("mcap", None), ("mcap", "storage"), ("db3", None), ("db3", "message")],
)
def test_a_bag_is_perturbed_and_keeps_its_other_topics(tmp_path, form, compression):
    place = tmp_path / f"{form}-{compression}"
    place.mkdir()
    source = walk(place, form, compression=compression)
    folder = perturbed(place / "made", source)
    out = place / ("bright.bag" if form == "ros1" else "bright")
    assert command.run("bag", [str(folder), "--out", str(out), "--over", str(source)], ENTRY) == 0
    assert texts(out) == texts(source)
    found, was = messages(out), messages(source)
    assert found.keys() == was.keys()
    dataset = find_sequence(folder)
    for topic in ("/camera/color/image_raw", "/camera/depth/image_raw"):
        for number, ((log_ns, image), (log_was_ns, image_was)) in enumerate(zip(found[topic], was[topic], strict=True)):
            assert (log_ns, image.encoding) == (log_was_ns, image_was.encoding)
            assert repr(image.header) == repr(image_was.header)  # their classes are made for each bag
            data = image.data.tobytes()
            if "color" in topic:
                np.testing.assert_array_equal(np.frombuffer(data, np.uint8).reshape(6, 8, 3), dataset.frame(number).rgb)
                assert np.mean(image.data) > np.mean(image_was.data) + 20
            else:
                assert data == image_was.data.tobytes()


@cases("shared", [False, True])
def test_depth_has_its_own_time_and_lens(tmp_path, shared):
    place = tmp_path / str(shared)
    place.mkdir()
    folder = perturbed(place / "made", walk(place, "ros1"))
    (params,) = place.glob("made/out/**/cam_params.json")
    document, lens = json.loads(params.read_text()), [0.1, -0.05, 0.001, 0.0]
    depth = {"w": 8, "h": 6, "fx": 7, "fy": 7, "cx": 3.5, "cy": 2.5, "shares_lens": shared}
    document |= {"distortion": {"model": "radial-tangential", "coefficients": lens}, "depth_camera": depth}
    params.write_text(json.dumps(document))
    assert command.run("bag", [str(folder), "--out", str(place / "own.bag")], ENTRY) == 0
    found = messages(place / "own.bag")
    for topic, late_ns, bent in (("/cam0", 0, True), ("/depth0", LATE_NS, shared)):
        stamps_ns = [[stamp_of(item) for _, item in found[f"{topic}/{name}"]] for name in ("image_raw", "camera_info")]
        assert stamps_ns == [[START_NS + number * STEP_NS + late_ns for number in range(4)]] * 2
        assert {tuple(item.D[:4]) for _, item in found[f"{topic}/camera_info"]} == {tuple(lens) if bent else (0,) * 4}


def test_what_cannot_be_is_refused_in_a_line(tmp_path, capsys):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    (tmp_path / "there").mkdir()
    (tmp_path / "in").mkdir()
    source = walk(tmp_path / "in", "ros1")
    other = made(tmp_path / "in/other", "tum")
    cases = {
        (str(tmp_path), str(tmp_path / "there")): "there: is there already",
        (str(tmp_path / "there"), str(tmp_path / "bag")): "is no sequence",
        (str(tmp_path), "--out", str(tmp_path / "b"), "--over", str(source)): "name b.bag",
        (str(tmp_path), "--out", str(tmp_path / "b.bag"), "--storage", "mcap"): "is for a folder",
        (
            str(other),
            "--out",
            str(tmp_path / "b.bag"),
            "--over",
            str(source),
        ): "name the bag that the sequence was made",
    }
    for words, told in cases.items():
        assert command.run("bag", list(words), ENTRY) != 0
        assert told in capsys.readouterr().err
    assert sorted(item.name for item in tmp_path.iterdir()) == ["in", "there"]


SLOPE, SHIFT = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0  # of inverse depth, as its codec has them by default


def others(bag):
    """Add colour and depth as other transports send them, and colour of which some frames are lost."""
    ros, smooth = bag.ros, np.full((6, 8, 3), 90, np.uint8)
    payload = cv2.imencode(".jpg", smooth)[1].tobytes()
    for number in range(4):
        stamp_ns = START_NS + number * STEP_NS
        depth_m = depth_mm(number) / 1000
        inverse = np.where(depth_m > 0, SLOPE / np.maximum(depth_m, 0.1) + SHIFT, 0).astype(np.uint16)
        packed = compressed_depth(inverse, (SLOPE, SHIFT))
        bag.add(stamp_ns + 5, "/jpeg/image/compressed", ros.compressed(stamp_ns, payload, "rgb8; jpeg compressed bgr8"))
        bag.add(stamp_ns + 5, "/jpeg/camera_info", ros.camera_info(stamp_ns, SIZE, K))
        bag.add(stamp_ns + 6, "/deep/image/compressedDepth", ros.compressed(stamp_ns, packed, "32FC1; compressedDepth"))


def test_other_encodings_are_written_as_they_were(tmp_path):
    source = walk(tmp_path, "ros1", change=others)
    topics = {"bag": str(source), "rgb": "/jpeg/image/compressed", "depth": "/deep/image/compressedDepth"}
    folder = perturbed(tmp_path / "made", topics, layout="replica")  # which has stamps in seconds alone
    out = tmp_path / "bright.bag"
    words = ["--rgb", "/jpeg/image/compressed", "--depth", "/deep/image/compressedDepth"]
    assert command.run("bag", [str(folder), "--out", str(out), "--over", str(source), *words], ENTRY) == 0
    found, was = messages(out), messages(source)
    for topic in found:
        assert [stamp_ns for stamp_ns, _ in found[topic]] == [stamp_ns for stamp_ns, _ in was[topic]]
    for number in range(4):
        (_, image), (_, image_was) = found["/jpeg/image/compressed"][number], was["/jpeg/image/compressed"][number]
        assert (repr(image.header), image.format) == (repr(image_was.header), image_was.format)
        assert cv2.imdecode(image.data, cv2.IMREAD_COLOR).mean() > 120
        (_, depth), (_, depth_was) = (bag["/deep/image/compressedDepth"][number] for bag in (found, was))
        steps = [cv2.imdecode(item.data[12:], cv2.IMREAD_UNCHANGED).astype(int) for item in (depth, depth_was)]
        assert depth.data[:12].tobytes() == depth_was.data[:12].tobytes()
        step = (
            0.5 * 10.0 / 65535 * SLOPE / (depth_mm(number) / 1000 + 1e-9) ** 2 + 1
        )  # of the dataset, in those of the bag
        assert (np.abs(steps[0] - steps[1]) <= np.where(steps[1] > 0, step, 0)).all()


def test_lost_frames_are_left_out_and_another_camera_is_told(tmp_path, capsys):
    source = walk(tmp_path, "mcap")
    folder = perturbed(tmp_path / "made", source)
    lists = {name: (folder / f"{name}.txt") for name in ("rgb", "depth", "groundtruth")}
    for file in lists.values():
        rows = file.read_text().splitlines()
        file.write_text("\n".join(row for number, row in enumerate(rows) if number != len(rows) - 2) + "\n")
    for name in ("frames.jsonl",):
        (folder / name).unlink(missing_ok=True)
    params = next(
        place / "cam_params.json" for place in (folder, folder.parent) if (place / "cam_params.json").exists()
    )
    params.write_text(params.read_text().replace("9.5", "9.75"))
    out = tmp_path / "copy"
    assert command.run("bag", [str(folder), "--out", str(out), "--over", str(source)], ENTRY) == 0
    assert "1 of 4 images of /camera/color/image_raw are left out" in capsys.readouterr().out
    found, was = messages(out), messages(source)
    assert [stamp for stamp, _ in found["/camera/color/image_raw"]] == [
        stamp for number, (stamp, _) in enumerate(was["/camera/color/image_raw"]) if number != 2
    ]
    assert len(found["/chatter"]) == 4
    assert {info.k[4] for _, info in found["/camera/color/camera_info"]} == {9.75}
    assert [info.header.stamp.nanosec for _, info in found["/camera/color/camera_info"]] == [
        info.header.stamp.nanosec for _, info in was["/camera/color/camera_info"]
    ]


@cases("form", ["ros1", "mcap", "db3"])
def test_frames_between_those_of_the_bag_are_put_in_by_time(tmp_path, form, capsys):
    (tmp_path / form).mkdir()
    bag = walk(tmp_path / form, form)
    source = bag if form == "ros1" else bag / f"walk.{form}"
    folder = perturbed(tmp_path / form / "made", source)
    (folder / "frames.jsonl").unlink()  # which would say the stamps too
    for name, later_s in {"rgb": ("0.007", "0", "0.007", "0"), "depth": ("0", "0.003", "0", "0")}.items():
        rows = [row.split() for row in (folder / f"{name}.txt").read_text().splitlines() if row[0] != "#"]
        late = [f"{Decimal(stamp) + Decimal(more)} {file}" for (stamp, file), more in zip(rows, later_s, strict=True)]
        (folder / f"{name}.txt").write_text("\n".join(late) + "\n")
    out = tmp_path / form / f"copy{source.suffix}"
    assert command.run("bag", [str(folder), "--out", str(out), "--over", str(source)], ENTRY) == 0
    assert "2 frames are put in" in capsys.readouterr().out
    colours = messages(out)["/camera/color/image_raw"]
    expected = [START_NS + number * STEP_NS + (number % 2 == 0) * 7_000_000 for number in range(4)]
    np.testing.assert_allclose([stamp_of(item) for _, item in colours], expected, rtol=0, atol=1000)
    dataset = find_sequence(folder)
    for number, (_, item) in enumerate(colours):
        np.testing.assert_array_equal(item.data.reshape(6, 8, 3), dataset.frame(number).rgb)
    assert texts(out) == texts(source)
    if form == "mcap":
        _check_summary(out)


def _check_summary(path):
    """Hold what an MCAP file's end says against the records in its chunks, which are not compressed."""
    everything = []
    records = [(kind, content) for kind, content in _records(path) if kind in (6, 8, 11)]
    indexes = [content for kind, content in records if kind == 8]
    chunks = [content for kind, content in records if kind == 6]
    for chunk, index in zip(chunks, indexes, strict=True):
        inside, at, times = chunk[40:], 0, []  # behind its times, sizes, checksum and the name of no compression
        while at < len(inside):
            kind, length = struct.unpack_from("<BQ", inside, at)
            times += [struct.unpack_from("<HIQ", inside, at + 9)[2]] if kind == 5 else []
            at += 9 + length
        assert struct.unpack_from("<QQ", chunk) == struct.unpack_from("<QQ", index) == (min(times), max(times))
        everything += times
    assert everything[-3:] == sorted(everything[-3:])  # those that were put in stand in the last one
    (told,) = [content for kind, content in records if kind == 11]
    count, first_ns, last_ns = (struct.unpack_from("<QHIIIIQQ", told)[field] for field in (0, 6, 7))
    assert (count, first_ns, last_ns) == (len(everything), min(everything), max(everything))


def _records(path):
    """Return the records of an MCAP file that are in no chunk: kind and content."""
    data, at, found = path.read_bytes(), 8, []
    while at < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        found.append((kind, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def test_a_copy_in_mcap_keeps_what_is_no_message(tmp_path):
    source = walk(tmp_path, "mcap")
    file = source / "walk.mcap"
    data = file.read_bytes()
    content = struct.pack("<QQI", 5, 6, 4) + b"name" + struct.pack("<I", 4) + b"text" + struct.pack("<Q", 2) + b"hi"
    attachment = struct.pack("<BQ", 9, len(content) + 4) + content + bytes(4)
    end = data.index(struct.pack("<BQ", 15, 4) + bytes(4))  # of the data
    file.write_bytes(data[:end] + attachment + _moved(data[end:], len(attachment)))
    out = tmp_path / "copy.mcap"
    folder = perturbed(tmp_path / "made", file)
    assert command.run("bag", [str(folder), "--out", str(out), "--over", str(file)], ENTRY) == 0
    of_kind = lambda path, kind: [content for found, content in _records(path) if found == kind]  # noqa: E731
    for kind in (1, 3, 4, 9, 12):  # header, schemas, channels, attachments, metadata
        assert of_kind(out, kind) == of_kind(file, kind) != []
    assert texts(out) == texts(file)
    (indexed,) = of_kind(out, 10)
    at, length = struct.unpack_from("<QQ", indexed)
    assert out.read_bytes()[at : at + length] == attachment


def _moved(data, count):
    """Return the end of a file behind something that was put in: where its summary is, moves too."""
    at = len(data) - 8 - 20
    start, _ = struct.unpack_from("<QQ", data, at)
    return data[:at] + struct.pack("<QQI", start + count, 0, 0) + data[-8:]


@pytest.mark.parametrize(
    ("encoding", "pixel", "written"),
    [
        ("bgr8", (30, 20, 10), "bgr8"),
        ("8UC3", (30, 20, 10), "8UC3"),
        ("rgba8", (10, 20, 30, 255), "rgba8"),
        ("bgra8", (30, 20, 10, 255), "bgra8"),
        ("8UC4", (30, 20, 10, 255), "8UC4"),
        ("bayer_rggb8", (10, 20, 30), "rgb8"),
    ],
)
def test_colour_is_written_in_the_order_of_its_encoding(encoding, pixel, written):
    from noisy_world.layouts.bag_writing import _as_encoded

    pixels, said = _as_encoded(np.full((2, 3, 3), (10, 20, 30), np.uint8), encoding)
    assert said == written
    assert pixels.shape == (2, 3, len(pixel))
    assert (pixels == pixel).all()
