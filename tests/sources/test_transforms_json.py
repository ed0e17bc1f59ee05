# SPDX-License-Identifier: GPL-3.0-or-later
"""transforms.json as NeRFCapture, Instant NGP, NeRF's Blender scenes and Windows write it."""

import json

import numpy as np
import pytest
from recorded_layouts import FRAMES, HALF_M, box_depth_m, colour, image, poses
from refusals import refused

from noisy_world.layouts import find_sequence

K = (33, 25, 30.0, 29.0, 15.5, 12.25)
C2W = poses(seed=41)
DEPTH_M = [box_depth_m(K, one) for one in C2W]
CAMERA = {"w": K[0], "h": K[1], "fl_x": K[2], "fl_y": K[3], "cx": K[4] + 0.5, "cy": K[5] + 0.5}


def written(folder, frame_of, *, camera=CAMERA, depth=None, **document):
    """Colour as rgb/N.png; depth(n, path stem) writes depth; frame_of(n): the keys of a frame beside its pose."""
    frames = []
    (folder / "d").mkdir()
    for n in range(FRAMES):
        image(folder / f"rgb/{n}.png", colour(K, n))
        if depth is not None:
            depth(n, folder / f"d/{n}")
        pose = (C2W[n] * np.array([1.0, -1.0, -1.0, 1.0])).tolist()
        frames.append({**frame_of(n), "transform_matrix": pose})
    (folder / "transforms.json").write_text(json.dumps({**camera, **document, "frames": frames}), encoding="utf-8-sig")
    return folder


def steps(scale_per_m):
    def write(n, stem):
        image(stem.with_suffix(".png"), np.rint(DEPTH_M[n] * scale_per_m).astype(np.uint16))

    return write


def array(factor, dtype=np.float32):
    return lambda n, stem: np.save(stem.with_suffix(".npy"), (DEPTH_M[n] * factor).astype(dtype))


def named(suffix="png", key="depth_path"):
    return lambda n: {"file_path": f"rgb/{n}.png", key: f"d/{n}.{suffix}"}


def sees_the_box(folder, within_m):
    stored = find_sequence(folder)
    assert len(stored.trajectory) == FRAMES
    rays = stored.known_camera.ray_directions()
    for row, c2w in enumerate(stored.trajectory.c2w):
        world = (rays * stored.frame(row).depth_m.astype(float)[..., None]) @ c2w[:3, :3].T + c2w[:3, 3]
        assert np.abs((np.abs(world) - HALF_M).max(axis=-1)).max() < within_m
    return stored


@pytest.mark.parametrize(
    ("frame_of", "depth", "document", "within_m"),
    [
        # NeRFCapture: depth_path, and metres a step.
        (named(), steps(6553.5), {"integer_depth_scale": 10 / 65535}, 3e-4),
        (named(key="depth_file_path"), steps(1000), {}, 2e-3),
        (named("npy"), array(1), {}, 1e-5),
        (named("npy", "depth_file_path"), array(1000), {}, 1e-5),
        (named("npy"), array(5000, np.uint16), {"integer_depth_scale": 0.0002}, 1e-3),
        # Instant NGP and NeRF: names without a suffix.
        (lambda n: {"file_path": f"./rgb/{n}", "depth_path": f"./d/{n}"}, steps(1000), {}, 2e-3),
        # Windows.
        (lambda n: {"file_path": f"rgb\\{n}.png", "depth_path": f".\\d\\{n}.png"}, steps(1000), {}, 2e-3),
    ],
)
def test_depth_is_found_and_has_its_scale(tmp_path, frame_of, depth, document, within_m):
    stored = sees_the_box(written(tmp_path, frame_of, depth=depth, **document), within_m)
    assert any("floating point" in note for note in stored.notes) == (stored.depth_files[0].suffix == ".npy" and "integer_depth_scale" not in document)  # fmt: skip  # noqa: E501


def test_intrinsics_that_differ_a_little_are_their_median(tmp_path):
    off_px = (0.1, 0.0, 0.0, -0.1)

    def frame_of(n):
        return {**named()(n), **CAMERA, "fl_x": CAMERA["fl_x"] + off_px[n], "cy": CAMERA["cy"] - off_px[n]}

    stored = sees_the_box(written(tmp_path, frame_of, camera={}, depth=steps(1000)), 2e-3)
    assert (stored.known_camera.fx_px, stored.known_camera.cy_px) == (K[2], K[5])
    assert [note for note in stored.notes if "differ" in note and "0.2 px" in note and "median" in note]
    document = json.loads((tmp_path / "transforms.json").read_text("utf-8-sig"))
    document["frames"][2]["fl_x"] = 33.0
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    refused(find_sequence, tmp_path, names=("transforms.json", "differ by 3.1 px", "one camera"))


def test_a_field_of_view_is_a_camera(tmp_path):
    angle = 2 * np.arctan(0.5 * K[0] / K[2])
    stored = find_sequence(written(tmp_path, lambda n: {"file_path": f"rgb/{n}"}, camera={"camera_angle_x": angle}))
    camera = stored.known_camera
    np.testing.assert_allclose([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px], [30, 30, 16, 12], atol=1e-9)
    assert not stored.depth_files


def test_frames_without_depth_are_left_out_and_said(tmp_path):
    written(tmp_path, lambda n: named()(n) if n else {"file_path": "rgb/0.png"}, depth=steps(1000))
    stored = find_sequence(tmp_path)
    np.testing.assert_allclose(stored.trajectory.c2w, C2W[1:], atol=1e-9)
    assert any("1 images are left out" in note for note in stored.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"integer_depth_scale": 1000}, ("integer_depth_scale", "the metres of a step; write 0.001")),
        ({"integer_depth_scale": "mm"}, ("integer_depth_scale", "number above 0")),
        ({"fl_x": None}, ("fl_x",)),
        ({"w": 64}, ("says 64 x 25", "0.png has 33 x 25")),
        ({"camera_model": "EQUIRECTANGULAR"}, ("camera_model", "OPENCV")),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, change, said):
    written(tmp_path, named(), depth=steps(1000))
    document = json.loads((tmp_path / "transforms.json").read_text("utf-8-sig"))
    (tmp_path / "transforms.json").write_text(json.dumps({**document, **change}))
    refused(lambda: find_sequence(tmp_path).known_camera, names=("transforms.json", *said))


def test_a_name_that_two_images_have_is_refused(tmp_path):
    written(tmp_path, lambda n: {"file_path": f"rgb/{n}"})
    image(tmp_path / "rgb/2.jpg", colour(K, 2))
    refused(find_sequence, tmp_path, names=("frames.2.file_path", "2.png or 2.jpg", "with its suffix"))
