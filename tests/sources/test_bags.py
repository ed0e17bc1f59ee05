# SPDX-License-Identifier: GPL-3.0-or-later
"""Bags of ROS as recordings. They are written by rosbags, which knows nothing of the reader that is tested."""

import math
import struct

import cv2
import made_bags as made
import numpy as np
import pytest
from cases import cases
from made_bags import BODY, DEPTH_OPTICAL, K, OPTICAL, SIZE, START_NS, STEP_NS, WORLD, bag, walk
from refusals import refused

from noisy_world.core.errors import InputError
from noisy_world.layouts import bag_files
from noisy_world.layouts.described import BagTopics
from noisy_world.layouts.bag_recording import interpolated, read_bag_sequence

FORMS = cases("form", made.FORMS)
COMPRESSED = [("ros1", "bz2"), ("ros1", "lz4"), ("db3", "message"), ("mcap", "storage"), ("mcap", "message")]
NO_POSES = BagTopics(poses="none", imu="none")


def matrix(values):
    """Return the matrix of x, y, z and a quaternion with w last, by Euler's and Rodrigues' formula."""
    x, y, z, w = values[3:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return np.block([[turned, np.array(values[:3])[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


# --- what a walk holds ---


@cases("form, compression", [*((form, None) for form in made.FORMS), *COMPRESSED])
def test_a_walk_is_read_to_the_bit(tmp_path, form, compression):
    stored = read_bag_sequence(walk(tmp_path, form, compression=compression), BagTopics())
    stamps_ns = tuple(START_NS + number * STEP_NS for number in range(4))
    assert stored.stamps.rgb.ns == stamps_ns
    assert stored.stamps.depth.ns == tuple(stamp_ns + made.LATE_NS for stamp_ns in stamps_ns)
    assert (stored.camera.fx_px, stored.camera.fy_px, stored.camera.cx_px, stored.camera.cy_px) == K
    assert stored.optics.plain
    assert not stored.notes
    for number in range(4):
        frame = stored.frame(number)
        np.testing.assert_array_equal(frame.rgb, made.colour(number))
        np.testing.assert_array_equal(np.rint(frame.depth_m.astype(np.float64) * 1000), made.depth_mm(number))
        expected = matrix(made.body(number)) @ matrix(made.OPTICAL_ON_BODY)
        np.testing.assert_allclose(stored.trajectory.c2w[number], expected, rtol=0, atol=1e-12)
    samples, rig = stored.imu.samples, stored.imu.rig
    assert samples.stamps_ns.tolist() == [stamp_ns + part * STEP_NS // 4 for stamp_ns in stamps_ns for part in range(4)]
    measured = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1)
    np.testing.assert_array_equal(measured, [np.concatenate(made.sample(index)) for index in range(16)])
    place = np.linalg.inv(matrix(made.IMU_ON_BODY)) @ matrix(made.OPTICAL_ON_BODY)
    np.testing.assert_allclose(rig.rgb.robot_from_sensor, place, rtol=0, atol=1e-12)


def test_a_file_of_a_folder_is_the_bag_too(tmp_path):
    for form, name in (("db3", "walk.db3"), ("mcap", "walk.mcap")):
        folder = walk(tmp_path, form)
        assert read_bag_sequence(folder / name, BagTopics()).stamps.rgb.ns[0] == START_NS
        (folder / "metadata.yaml").unlink()
        assert read_bag_sequence(folder, BagTopics()).stamps.rgb.ns[0] == START_NS


def test_several_files_are_one_bag(tmp_path):
    folder = walk(tmp_path, "db3", frames=2)

    def later(other):
        for number in (2, 3):
            image = other.ros.image(START_NS + number * STEP_NS, made.colour(number), "rgb8")
            other.add(START_NS + number * STEP_NS, "/camera/color/image_raw", image)

    with bag(tmp_path, "db3", "more") as other:
        later(other)
    (other.path / "more.db3").rename(folder / "walk_1.db3")
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(text.replace("relative_file_paths:", "relative_file_paths:\n  - walk_1.db3"))
    stored = read_bag_sequence(folder, BagTopics(depth="none", imu="none", poses="none"))
    assert [stored.frame(number).rgb.tolist() for number in range(4)] == [made.colour(n).tolist() for n in range(4)]


# --- images ---

BAYER = {"rggb": "rggb", "bggr": "bggr", "gbrg": "gbrg", "grbg": "grbg"}


def mosaic(order, rgb):
    """Return what a sensor under a mosaic of filters sees of one colour: its first two rows say the order."""
    of_letter = dict(zip("rgb", rgb, strict=True))
    tile = np.array([of_letter[letter] for letter in order], np.uint8).reshape(2, 2)
    return np.tile(tile, (SIZE[1] // 2, SIZE[0] // 2))


def yuv(order, luma):
    """Return a grey image as YUV of two pixels at once; order: of the bytes of two pixels."""
    of_letter = {"u": np.full_like(luma[:, ::2], 128), "v": np.full_like(luma[:, ::2], 128)}
    planes = iter((luma[:, ::2], luma[:, 1::2]))
    values = [next(planes) if letter == "y" else of_letter[letter] for letter in order]
    return np.stack(values, axis=-1).reshape(luma.shape[0], luma.shape[1], 2)


RGB = made.colour(0)
GREY = RGB[..., 0]
LUMA = np.linspace(16, 235, GREY.size).astype(np.uint8).reshape(GREY.shape)
FROM_LUMA = np.clip(np.rint((LUMA.astype(float) - 16) * 255 / 219), 0, 255)  # BT.601, limited range
ENCODED = {
    "rgb8": (RGB, RGB),
    "bgr8": (RGB[..., ::-1], RGB),
    "rgba8": (np.dstack([RGB, GREY]), RGB),
    "bgra8": (np.dstack([RGB[..., ::-1], GREY]), RGB),
    "mono8": (GREY, np.repeat(GREY[..., None], 3, axis=2)),
    "8UC3": (RGB[..., ::-1], RGB),
    **{f"bayer_{order}8": (mosaic(order, (200, 90, 30)), np.full_like(RGB, (200, 90, 30))) for order in BAYER},
    "yuv422": (yuv("uyvy", LUMA), np.repeat(FROM_LUMA[..., None], 3, axis=2)),
    "yuv422_yuy2": (yuv("yuyv", LUMA), np.repeat(FROM_LUMA[..., None], 3, axis=2)),
}


def one_image(folder, form, message_of, topic="/cam/image", kinds=1):
    """Write a bag with one image twice, a step apart; message_of: called with messages of ROS and a stamp."""
    with bag(folder, form) as written:
        for number in range(2):
            stamp_ns = START_NS + number * STEP_NS
            written.add(stamp_ns, topic, message_of(written.ros, stamp_ns))
            if kinds == 2:
                written.add(stamp_ns, "/cam/colour", written.ros.image(stamp_ns, RGB, "rgb8"))
    return written.path


@cases("encoding", ENCODED)
def test_raw_colour(tmp_path, encoding):
    pixels, expected = ENCODED[encoding]
    path = one_image(tmp_path, "mcap", lambda ros, at: ros.image(at, pixels, encoding, fill=3))
    found = read_bag_sequence(path, NO_POSES).frame(1).rgb
    assert np.abs(found.astype(int) - expected).max() <= (1 if "yuv" in encoding else 0)


@cases("form", ("ros1", "mcap"))
@cases("suffix", (".png", ".jpg"))
def test_compressed_colour(tmp_path, form, suffix):
    down, right = np.mgrid[0:24, 0:32]
    smooth = np.stack([8 * right, 10 * down, 255 - 4 * right - 4 * down], axis=-1).astype(np.uint8)
    payload = cv2.imencode(suffix, smooth[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    kind = "rgb8; jpeg compressed bgr8" if suffix == ".jpg" else "png"
    path = one_image(tmp_path, form, lambda ros, at: ros.compressed(at, payload, kind), "/cam/image/compressed")
    stored = read_bag_sequence(path, NO_POSES)
    assert stored.size_px == (32, 24)
    assert stored.encoded_colour(0) == payload
    assert np.abs(stored.frame(0).rgb.astype(int) - smooth).max() <= (0 if suffix == ".png" else 9)


STEPS = made.depth_mm(0)
# compressed_depth_image_transport's defaults: depth_max 10 m, depth_quantization 100.
SLOPE = 100.0 * 101.0
SHIFT = 1.0 - SLOPE / 10.0


def quantised(depth_m):
    """Return the inverse depth as the codec of compressed_depth_image_transport has it."""
    inverse = SLOPE / np.where(depth_m > 0, depth_m, 1) + SHIFT
    return np.where(depth_m > 0, inverse, 0).astype(np.uint16)


METRES = (STEPS / 1000).astype(np.float32)
HOLES = np.where(METRES > 0, METRES, np.nan).astype(np.float32)
DEPTHS = {
    "16UC1": lambda ros, at: ros.image(at, STEPS, "16UC1"),
    "mono16, big endian": lambda ros, at: ros.image(at, STEPS, "mono16", big_endian=True, fill=4),
    "32FC1": lambda ros, at: ros.image(at, HOLES, "32FC1"),
    "32FC1, infinite": lambda ros, at: ros.image(at, np.where(METRES > 0, METRES, np.inf).astype("<f4"), "32FC1"),
    "16UC1; compressedDepth": lambda ros, at: ros.compressed(
        at, made.compressed_depth(STEPS), "16UC1; compressedDepth png"
    ),
    "16UC1; png compressed": lambda ros, at: ros.compressed(
        at, cv2.imencode(".png", STEPS)[1].tobytes(), "16UC1; png compressed "
    ),
}


@cases("kind", DEPTHS)
def test_depth(tmp_path, kind):
    topic = "/cam/depth/compressedDepth" if ";" in kind else "/cam/depth"
    stored = read_bag_sequence(one_image(tmp_path, "mcap", DEPTHS[kind], topic, kinds=2), NO_POSES)
    np.testing.assert_array_equal(stored.frame(1).depth_m, METRES)


@FORMS
def test_inverse_depth_is_that_of_the_codec(tmp_path, form):
    payload = made.compressed_depth(quantised(METRES), (SLOPE, SHIFT))
    kind = "32FC1; compressedDepth"
    path = one_image(tmp_path, form, lambda ros, at: ros.compressed(at, payload, kind), "/d/compressedDepth", kinds=2)
    found = read_bag_sequence(path, NO_POSES).frame(0).depth_m
    assert (found[METRES == 0] == 0).all()
    step_m = METRES**2 / SLOPE  # of one digit of the inverse, at that depth
    assert (np.abs(found - METRES) <= 1.01 * step_m + 1e-6).all()


def test_depth_in_other_steps(tmp_path):
    path = one_image(tmp_path, "db3", DEPTHS["16UC1"], "/cam/depth", kinds=2)
    found = read_bag_sequence(path, NO_POSES, "none", 5000.0).frame(0).depth_m
    np.testing.assert_array_equal(found, (STEPS / 5000).astype(np.float32))


# --- cameras ---

RATIONAL = (0.1, -0.05, 0.001, 0.002, 0.01, 0.02, -0.01, 0.003)
LENSES = {
    "none": (("plumb_bob", (0.0,) * 5), {}, None),
    "five": (("plumb_bob", RATIONAL[:5]), {}, ("radial-tangential", RATIONAL[:5])),
    "four": (("plumb_bob", (*RATIONAL[:4], 0.0)), {}, ("radial-tangential", RATIONAL[:4])),
    "eight": (("rational_polynomial", RATIONAL), {}, ("radial-tangential", RATIONAL)),
    "angle": (("equidistant", RATIONAL[:4]), {}, ("equidistant", RATIONAL[:4])),
}


def camera_of(folder, form, topic="/cam/image", **given):
    with bag(folder, form) as written:
        written.add(1, topic, written.ros.image(START_NS, RGB, "rgb8"))
        name = topic.rpartition("/")[0] + "/camera_info"
        written.add(1, name, written.ros.camera_info(START_NS, given.pop("size", SIZE), K, **given))
    return read_bag_sequence(written.path, NO_POSES)


@cases("form", ("ros1", "mcap"))
@cases("lens", LENSES)
def test_lenses(tmp_path, form, lens):
    (model, coefficients), given, expected = LENSES[lens]
    stored = camera_of(tmp_path, form, model=model, d=coefficients, **given)
    found = stored.optics.distortion
    assert (None if found is None else (found.model, found.coefficients)) == expected
    assert (stored.camera.fx_px, stored.camera.cy_px) == (K[0], K[3])


def test_a_region_and_binning_make_another_camera(tmp_path):
    # K is that of the whole image; a pixel that is sent stands for 2 x 2, the first at (4, 2). As image_geometry does.
    stored = camera_of(tmp_path, "mcap", size=(20, 14), binning=2, roi=(4, 2, 12, 16))
    camera = stored.camera
    assert (camera.width_px, camera.height_px) == SIZE
    found = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    assert found == (K[0] / 2, K[1] / 2, (K[2] - 4) / 2, (K[3] - 2) / 2)


def test_rectified_images_have_the_projection_and_no_lens(tmp_path):
    given = {"model": "plumb_bob", "d": RATIONAL[:5], "p": (8.0, 8.5, 3.0, 2.0)}
    stored = camera_of(tmp_path, "mcap", "/cam/image_rect", **given)
    assert stored.camera.fx_px == 8.0
    assert stored.optics.distortion is None


def test_depth_with_a_camera_of_its_own(tmp_path):
    place = (0.015, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    with bag(tmp_path, "mcap") as written:
        ros = written.ros
        written.add(1, "/tf_static", ros.tf(ros.transform(1, OPTICAL, DEPTH_OPTICAL, place)))
        written.add(1, "/color/image", ros.image(START_NS, RGB, "rgb8"))
        written.add(1, "/color/camera_info", ros.camera_info(START_NS, SIZE, K))
        written.add(1, "/depth/image", ros.image(START_NS, STEPS[:4], "16UC1", DEPTH_OPTICAL))
        info = ros.camera_info(START_NS, (8, 4), (7.0, 7.0, 3.0, 1.5), frame=DEPTH_OPTICAL)
        written.add(1, "/depth/camera_info", info)
    depth = read_bag_sequence(written.path, NO_POSES).optics.depth
    assert (depth.intrinsics.fx_px, depth.intrinsics.height_px) == (7.0, 4)
    np.testing.assert_allclose(depth.matrix, matrix(place), atol=1e-12)


# --- poses ---

POSE_TOPICS = {
    "pose_stamped": (lambda ros, at, values: ros.pose_stamped(at, values), False),
    "pose_with_covariance": (lambda ros, at, values: ros.pose_with_covariance(at, values), False),
    "odometry": (lambda ros, at, values: ros.odometry(at, values), True),
    "transform": (lambda ros, at, values: ros.transform(at, WORLD, BODY, values), True),
}


@cases("form", ("ros1", "mcap"))
@cases("kind", POSE_TOPICS)
def test_topics_of_poses(tmp_path, form, kind):
    message, names_body = POSE_TOPICS[kind]
    with bag(tmp_path, form) as written:
        ros = written.ros
        written.add(1, "/tf_static", ros.tf(ros.transform(1, BODY, OPTICAL, made.OPTICAL_ON_BODY)))
        for number in range(3):
            stamp_ns = START_NS + number * STEP_NS
            written.add(stamp_ns, "/truth", message(ros, stamp_ns, made.body(number)))
            written.add(stamp_ns, "/cam/image", ros.image(stamp_ns, RGB, "rgb8"))
    path = written.path
    on_body = matrix(made.OPTICAL_ON_BODY)
    told, plain = read_bag_sequence(path, BagTopics(body=BODY)), read_bag_sequence(path, BagTopics())
    for number in range(3):
        expected = matrix(made.body(number))
        np.testing.assert_allclose(told.trajectory.c2w[number], expected @ on_body, atol=1e-12)
        own = expected @ on_body if names_body else expected
        np.testing.assert_allclose(plain.trajectory.c2w[number], own, atol=1e-12)
    assert bool(plain.notes) != names_body  # where nothing names the body, that is said


def test_a_chain_of_moving_frames_is_interpolated(tmp_path):
    # map -> odom slides, odom -> base turns about z at a constant rate; both are known at other times than images are.
    def turn(angle):
        return (0.0, 0.0, 0.0, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))

    with bag(tmp_path, "mcap") as written:
        ros = written.ros
        written.add(1, "/tf_static", ros.tf(ros.transform(1, BODY, OPTICAL, made.OPTICAL_ON_BODY)))
        for at_s in (0.0, 0.4, 0.8):
            slid = ros.transform(round(at_s * 1e9), WORLD, "odom", (2.0 * at_s, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            written.add(1, "/tf", ros.tf(slid))
        for at_s in (0.1, 0.3, 0.7):
            written.add(1, "/tf", ros.tf(ros.transform(round(at_s * 1e9), "odom", BODY, turn(1.5 * at_s))))
        for at_s in (0.0, 0.2, 0.5, 0.9):
            written.add(1, "/cam/image", ros.image(round(at_s * 1e9) + (at_s == 0), RGB, "rgb8"))
    stored = read_bag_sequence(written.path, BagTopics(), "keep")
    assert stored.trajectory.known.tolist() == [False, True, True, False]
    for row, at_s in ((1, 0.2), (2, 0.5)):
        slid = matrix((2.0 * at_s, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        expected = slid @ matrix(turn(1.5 * at_s)) @ matrix(made.OPTICAL_ON_BODY)
        np.testing.assert_allclose(stored.trajectory.c2w[row], expected, atol=1e-12)
    assert len(read_bag_sequence(written.path, BagTopics()).stamps) == 2


def test_no_pose_is_made_up_in_a_gap():
    values = np.array([[float(at), 0, 0, 0, 0, 0, 1] for at in range(4)])
    stamps_ns = np.array([0, 1, 3, 4]) * 10**9
    _, known = interpolated(stamps_ns, values, np.array([-1, 0, 5, 20, 30, 40, 41]) * 10**8)
    assert known.tolist() == [False, True, True, False, True, True, False]


# --- which topics ---


def two_cameras(written):
    written.add(START_NS, "/left/image", written.ros.image(START_NS, RGB, "rgb8"))
    written.add(START_NS, "/odom", written.ros.odometry(START_NS, made.body(0)))


CHOICES = {
    "colour": (BagTopics(poses="none"), "several topics that may be rgb: /camera/color/image_raw, /left/image"),
    "poses": (BagTopics(rgb="/left/image"), "several topics that may be poses: /odom, /tf"),
    "misspelt": (BagTopics(rgb="/left/imag"), "has no topic /left/imag did you mean '/left/image'?"),
    "of another kind": (
        BagTopics(rgb="/chatter"),
        "has /chatter of the type std_msgs/msg/String, which is none for rgb",
    ),
    "depth as colour": (BagTopics(rgb="/camera/depth/image_raw", poses="none"), "that of depth and no colour"),
}


@cases("choice", CHOICES)
def test_what_is_not_clear_is_asked_in_a_line(tmp_path, choice):
    asked, told = CHOICES[choice]
    path = walk(tmp_path, "mcap", change=two_cameras)
    with pytest.raises(InputError) as caught:
        read_bag_sequence(path, asked).frame(0).rgb  # noqa: B018 - reads it
    assert told in str(caught.value)
    assert str(path) in str(caught.value)


def test_what_is_sent_raw_and_compressed_is_one_image(tmp_path):
    payload = cv2.imencode(".png", RGB)[1].tobytes()

    def more(written):
        message = written.ros.compressed(START_NS, payload, "rgb8; png compressed bgr8")
        written.add(START_NS, "/camera/color/image_raw/compressed", message)

    stored = read_bag_sequence(walk(tmp_path, "ros1", change=more), BagTopics())
    assert stored.rgb.name == "/camera/color/image_raw"
    assert stored.encoded_colour(0) == b""


def test_doubled_and_late_images(tmp_path):
    with bag(tmp_path, "db3") as written:
        for number in (1, 0, 1, 2):
            stamp_ns = START_NS + number * STEP_NS
            written.add(START_NS, "/cam/image", written.ros.image(stamp_ns, made.colour(number), "rgb8"))
    stored = read_bag_sequence(written.path, NO_POSES)
    assert [stored.frame(number).rgb.tolist() for number in range(3)] == [made.colour(n).tolist() for n in range(3)]
    assert "1 of 4 images of /cam/image have the stamp of another" in " ".join(stored.notes)


def test_without_stamps_the_times_of_recording_count(tmp_path):
    with bag(tmp_path, "mcap") as written:
        for number in range(2):
            written.add(START_NS + number * STEP_NS, "/cam/image", written.ros.image(0, RGB, "rgb8"))
    stored = read_bag_sequence(written.path, NO_POSES)
    assert stored.stamps.rgb.ns == (START_NS, START_NS + STEP_NS)
    assert "say no time" in " ".join(stored.notes)


# --- files that are not what they should be ---


def cut(path, share=0.6):
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])


def unindexed(path):
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:at] + bytes(8) + data[at + 8 :])


def swapped(old, new):
    return lambda path: path.write_bytes(path.read_bytes().replace(old, new))


def bomb(path):
    """Say that a chunk holds 900 MB."""
    data = path.read_bytes()
    at = data.index(b"compression=lz4")
    size = data.index(b"size=", at) + 5
    path.write_bytes(data[:size] + struct.pack("<L", 9 * 10**8) + data[size + 4 :])


def bombs(path):
    """Put in more chunks by the hundred, each 200 MB of zeros in 9 kB."""
    import backports.zstd

    whole = 2 * 10**8
    zeros = backports.zstd.compress(bytes(whole))
    head = struct.pack("<QQQI", 1, 2, whole, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(zeros))
    data = path.read_bytes()
    end = data.index(struct.pack("<BQ", 15, 4) + bytes(4))
    chunk = struct.pack("<BQ", 6, len(head) + len(zeros)) + head + zeros
    path.write_bytes(data[:end] + 200 * chunk + data[end:])


def lying(path):
    """Say that a chunk holds more than it does."""
    data = path.read_bytes()
    size = data.index(b"size=", data.index(b"compression=lz4")) + 5
    (was,) = struct.unpack_from("<L", data, size)
    path.write_bytes(data[:size] + struct.pack("<L", was + 100) + data[size + 4 :])


DAMAGED = {
    "empty": ("ros1", None, lambda path: path.write_bytes(b""), "is an empty file"),
    "a text": ("ros1", None, lambda path: path.write_text("# no bag\n" * 9), "is no bag of ROS"),
    "ROS 1, cut": ("ros1", None, cut, "is damaged"),
    "ROS 1, not indexed": ("ros1", None, unindexed, "has no index: its recording was cut; run rosbag reindex"),
    "ROS 1, version": ("ros1", None, swapped(b"#ROSBAG V2.0", b"#ROSBAG V1.2"), "is a bag of version '1.2'"),
    "ROS 1, compression": ("ros1", "lz4", swapped(b"=lz4", b"=lz5"), "is compressed by 'lz5'"),
    "ROS 1, topic": ("ros1", None, swapped(b"topic=/chatter", b"topic=/ch\xfftter"), "is damaged"),
    "ROS 1, bomb": ("ros1", "lz4", bomb, "at most 268435456 are read"),
    "ROS 1, lying": ("ros1", "lz4", lying, "a chunk says"),
    "MCAP, cut": ("mcap", None, cut, "has no end: its recording or copying was cut; run mcap recover"),
    "MCAP, bombs": ("mcap", None, bombs, "that is no recording"),
    "MCAP, middle": ("mcap", None, swapped(b"\x05", b"\xf5"), ""),
    "SQLite, cut": ("db3", None, cut, "is damaged"),
    "SQLite, other": ("db3", None, swapped(b"messages", b"massages"), "is no bag"),
}


@cases("kind", DAMAGED)
def test_damaged_bags_are_refused_in_a_line(tmp_path, kind):
    form, compression, damage, told = DAMAGED[kind]
    path = walk(tmp_path, form, compression=compression)
    file = path if path.is_file() else path / f"walk.{form}"
    damage(file)
    refused(_whole, file, names=[told, str(file)])


def _whole(path):
    stored = read_bag_sequence(path, BagTopics())
    return [(stored.frame(number).rgb, stored.frame(number).depth_m) for number in range(len(stored.stamps))]


def test_a_view_in_place_of_a_table_is_refused(tmp_path):
    import sqlite3

    file = walk(tmp_path, "db3") / "walk.db3"
    with sqlite3.connect(file) as database:
        database.execute("ALTER TABLE messages RENAME TO kept")
        endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
        database.execute(f"CREATE VIEW messages AS {endless} SELECT i id, 1 topic_id, i timestamp, '' data FROM n")
    database.close()
    refused(_whole, file, names=["has no table messages", str(file)])


def test_chunks_are_not_decompressed_beyond_what_they_say():
    zeros = pytest.importorskip("lz4.frame", reason="lz4 is not installed").compress(bytes(10**8))
    assert bag_files.decompressed(zeros, "lz4", 1000, None) == bytes(1000)


def bare_mcap(path, ros, kind, encoding, definitions=True):
    """Write an MCAP file without chunks, indexes and summary, as a recorder that is in a hurry does, by hand."""

    def record(kind, content):
        return struct.pack("<BQ", kind, len(content)) + content

    def text(value):
        return struct.pack("<I", len(value)) + value.encode()

    parts = [record(1, text("") + text("by hand"))]
    if definitions:
        parts += [record(3, struct.pack("<H", 1) + text(kind) + text("ros2msg") + text(""))]
        parts += [record(4, struct.pack("<HH", 5, 1) + text("/cam/image") + text(encoding) + text(""))]
    for number in range(3):
        stamp_ns = START_NS + number * STEP_NS
        data = ros.serialised(ros.image(stamp_ns, made.colour(number), "rgb8"))
        parts.append(record(5, struct.pack("<HIQQ", 5, number, stamp_ns, stamp_ns) + data))
    end = record(15, bytes(4)) + record(2, bytes(20))
    path.write_bytes(b"\x89MCAP0\r\n" + b"".join(parts) + end + b"\x89MCAP0\r\n")
    return path


@cases("form, kind, encoding", [("mcap", "sensor_msgs/msg/Image", "cdr"), ("ros1", "sensor_msgs/Image", "ros1")])
def test_mcap_without_chunks_and_summary(tmp_path, form, kind, encoding):
    path = bare_mcap(tmp_path / f"{form}.mcap", made.ros_of(form), kind, encoding)
    stored = read_bag_sequence(path, NO_POSES)
    assert [stored.frame(number).rgb.tolist() for number in range(3)] == [made.colour(n).tolist() for n in range(3)]


def test_messages_of_no_topic_are_refused(tmp_path):
    path = bare_mcap(tmp_path / "none.mcap", made.ros_of("mcap"), "sensor_msgs/msg/Image", "cdr", definitions=False)
    refused(_whole, path, names=["a message is of no topic", str(path)])


def _message(ros, at, change):
    message = ros.image(at, RGB, "rgb8")
    for name, value in change.items():
        setattr(message, name, value)
    return message


@cases("size_px", [(8, 5), (7, 6)])
def test_images_of_another_size_than_the_first_are_refused(tmp_path, size_px):
    place, sizes = tmp_path / str(size_px), iter([(8, 6), size_px])
    place.mkdir()
    path = one_image(place, "ros1", lambda ros, at: ros.image(at, np.zeros((*next(sizes)[::-1], 3), np.uint8), "rgb8"))
    names = [str(path), "message 1 is {} x {} pixels, but 8 x 6".format(*size_px)]
    refused(lambda: read_bag_sequence(path, NO_POSES).image_notes, names=names)


MESSAGES = {
    "encoding": ({"encoding": "rgb9"}, "its encoding is 'rgb9'"),
    "size": ({"width": 9}, "it says 9 x 6 pixels"),
    "step": ({"step": 3}, "3 a row"),
    "huge": ({"width": 2**31, "height": 2**31}, "pixels; at most"),
    "none": ({"height": 0}, "it says 8 x 0 pixels"),
}


@cases("form", ("ros1", "mcap"))
@cases("kind", MESSAGES)
def test_images_that_lie_are_refused_in_a_line(tmp_path, form, kind):
    change, told = MESSAGES[kind]
    path = one_image(tmp_path, form, lambda ros, at: _message(ros, at, change))
    with pytest.raises(InputError) as caught:
        read_bag_sequence(path, NO_POSES).frame(0).rgb  # noqa: B018 - reads it
    assert told in str(caught.value)
    assert "/cam/image" in str(caught.value)
