# SPDX-License-Identifier: GPL-3.0-or-later
"""A preset says where a recording's files are, where no layout is told by them."""

import json

import cv2
import numpy as np
import pytest
from recorded_layouts import FRAMES, HALF_M, box_depth_m, colour, image, poses, text_of
from recorded_presets import preset_of
from refusals import refused
from runs import run
from scipy.spatial.transform import Rotation

from noisy_world.dataset.plan import make_plan
from noisy_world.core.schema import ConfigPath, parse
from noisy_world.layouts import find_sequence
from noisy_world.layouts.described import SequenceSpec, check_sequence
from noisy_world.preset.keys import read_preset

K = (33, 25, 30.0, 29.0, 15.5, 12.25)  # an odd size
C2W = poses(seed=40)
DEPTH_M = [box_depth_m(K, one) for one in C2W]
INTRINSICS = dict(zip(("fx", "fy", "cx", "cy"), K[2:], strict=True))


def matrices(folder, c2w=C2W, name="poses.txt"):
    (folder / name).write_text("".join(map(text_of, c2w)))


def written(folder, *, names="{n}", depth="depth/{n}.png", make=lambda n: np.rint(DEPTH_M[n] * 1000).astype(np.uint16)):
    """A folder of colour and one of depth, that no layout knows."""
    folder.mkdir(exist_ok=True)
    for n in range(FRAMES):
        image(folder / f"shots/{names.format(n=n)}.png", colour(K, n))
        path = folder / depth.format(n=n)
        if path.suffix == ".npy":
            path.parent.mkdir(exist_ok=True)
            np.save(path, make(n))
        else:
            image(path, make(n))
    return folder


def stored_of(folder, described, **keys):
    path = preset_of(folder / "p", {"name": "box", "sequence": {"folder": str(folder), **described}, **keys})
    (scene,) = make_plan(read_preset(path)).scenes
    return scene.source.stored


def sees_the_box(stored, scale_per_m):
    """What a pixel shows lies on the box, seen from every frame: intrinsics, poses and depth agree."""
    rays = stored.known_camera.ray_directions()
    for row, c2w in enumerate(stored.trajectory.c2w):
        world = (rays * stored.frame(row).depth_m.astype(float)[..., None]) @ c2w[:3, :3].T + c2w[:3, 3]
        assert np.abs((np.abs(world) - HALF_M).max(axis=-1)).max() < 1.5 / scale_per_m


PLAIN = {"rgb": "shots/*.png", "depth": "depth/*.png", "intrinsics": INTRINSICS, "poses": "poses.txt"}


def test_a_folder_of_colour_and_one_of_depth(tmp_path):
    matrices(written(tmp_path / "r"))
    stored = stored_of(tmp_path / "r", PLAIN)
    np.testing.assert_allclose(stored.trajectory.c2w, C2W, rtol=0, atol=1e-12)
    np.testing.assert_allclose(stored.stamps.rgb.seconds, np.arange(FRAMES) / 30)
    sees_the_box(stored, 1000)
    # It is written as any other, and what is written is what was recorded.
    scene = {"name": "box", "sequence": {"folder": str(tmp_path / "r"), **PLAIN}}
    run(preset_of(tmp_path / "p", scene, output={"layout": "tum"}), tmp_path / "out")
    again = find_sequence(tmp_path / "out/clean/box")
    assert np.abs(again.trajectory.c2w - C2W).max() < 1e-9
    for row in range(FRAMES):
        assert np.abs(again.frame(row).depth_m - stored.frame(row).depth_m).max() <= 0.5001 / 5000
        assert np.array_equal(again.frame(row).rgb, stored.frame(row).rgb)
    entry = json.loads((tmp_path / "out/manifest.json").read_text())["identity"]["scenes"]["box"]["entry"]
    assert entry["sequence"]["depth"]["files"] == "depth/*.png"


@pytest.mark.parametrize(
    ("told", "turn"),
    [
        ({"axes": "opengl"}, lambda c2w: c2w @ np.diag([1.0, -1, -1, 1])),
        ({"pose": "w2c"}, np.linalg.inv),
        ({"pose": "w2c", "axes": "opengl"}, lambda c2w: np.linalg.inv(c2w @ np.diag([1.0, -1, -1, 1]))),
    ],
)
def test_conventions_of_poses_are_those_of_any_path(tmp_path, told, turn):
    matrices(written(tmp_path / "r"), turn(C2W))
    found = stored_of(tmp_path / "r", {**PLAIN, "poses": {"file": "poses.txt", **told}})
    np.testing.assert_allclose(found.trajectory.c2w, C2W, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("depth", "make", "told", "scale_per_m"),
    [
        ("depth/{n}.npy", lambda n: DEPTH_M[n].astype(np.float32), {}, 1e6),
        ("depth/{n}.npy", lambda n: (DEPTH_M[n] * 100).astype(np.float64), {"scale_per_m": 100}, 1e6),
        ("depth/{n}.tiff", lambda n: DEPTH_M[n].astype(np.float32), {}, 1e6),
        ("depth/{n}.tif", lambda n: np.rint(DEPTH_M[n] * 5000).astype(np.uint16), {"scale_per_m": 5000}, 5000),
    ],
)
def test_depth_has_a_scale_that_is_said_or_that_of_its_numbers(tmp_path, depth, make, told, scale_per_m):
    matrices(written(tmp_path / "r", depth=depth, make=make))
    described = {**PLAIN, "depth": {"files": depth.format(n="*"), **told}}
    sees_the_box(stored_of(tmp_path / "r", described), scale_per_m)


def test_values_of_void_are_said(tmp_path):
    def make(n):
        steps = np.rint(DEPTH_M[n] * 1000).astype(np.uint16)
        steps[:3] = 65535
        return steps

    matrices(written(tmp_path / "r", make=make))
    found = stored_of(tmp_path / "r", {**PLAIN, "depth": {"files": "depth/*.png", "void": [65535]}})
    assert not found.frame(0).depth_m[:3].any()
    assert found.frame(0).depth_m[3:].all()


def test_images_and_poses_are_paired_by_time(tmp_path):
    folder = tmp_path / "r"
    stamps_s = [f"{1305031102 + n}.{175304 + n}" for n in range(FRAMES)]
    late_s = [f"{1305031102 + n}.{180304 + n}" for n in range(FRAMES)]
    for n in range(FRAMES):
        image(folder / f"shots/{stamps_s[n]}.png", colour(K, n))
        image(folder / f"depth/{late_s[n]}.png", np.rint(DEPTH_M[n] * 1000).astype(np.uint16))
    rows = [
        " ".join(map(str, [stamps_s[n], *C2W[n, :3, 3], *Rotation.from_matrix(C2W[n, :3, :3]).as_quat()]))
        for n in range(1, FRAMES)
    ]
    (folder / "truth.txt").write_text("\ufeff# t x y z qx qy qz qw\r\n" + "\r\n".join(rows) + "\r\n")
    by_name = {**PLAIN, "poses": "truth.txt", "stamps": {"names": True}}
    lists = {"rgb": {"list": "rgb.txt"}, "depth": {"list": "depth.txt"}}
    for kind, stamps, inside in (("rgb", stamps_s, "shots"), ("depth", late_s, "depth")):
        text = "".join(f"{stamp} {inside}\\{stamp}.png\n" for stamp in stamps)  # as Windows has it
        (folder / f"{kind}.txt").write_text(text, encoding="utf-8-sig")
    for described in (by_name, {**PLAIN, "poses": "truth.txt", **lists}):
        found = stored_of(folder, described)
        assert [str(stamp) for stamp in found.stamps.rgb.exact_ns] == [f"{s.replace('.', '')}000" for s in stamps_s[1:]]
        assert [str(stamp) for stamp in found.stamps.depth.exact_ns] == [f"{s.replace('.', '')}000" for s in late_s[1:]]
        np.testing.assert_allclose(found.trajectory.c2w, C2W[1:], rtol=0, atol=1e-9)
        sees_the_box(found, 1000)
    (folder / "times.txt").write_text("".join(f"{stamp}\n" for stamp in stamps_s))
    found = stored_of(folder, {**PLAIN, "poses": "truth.txt", "stamps": "times.txt"})
    assert any("the i-th of one belongs to the i-th of the other" in note for note in found.notes)
    np.testing.assert_allclose(found.trajectory.c2w, C2W[1:], rtol=0, atol=1e-9)


def test_names_that_are_times_are_in_order_of_time(tmp_path):
    for n, name in enumerate(times_s := ("1.25", "1.5", "2", "2.125")):  # by the numbers in it, 1.5 is before 1.25
        image(tmp_path / f"r/shots/{name}.png", colour(K, n))
    described = {"folder": str(tmp_path / "r"), "rgb": "shots/*.png", "intrinsics": INTRINSICS}
    scene = {"sequence": {**described, "stamps": {"names": True}}}
    path = preset_of(tmp_path / "p", scene, output={"modalities": ["rgb"]})
    found = make_plan(read_preset(path)).scenes[0].source.stored
    assert [path.stem for path in found.rgb_files] == list(times_s)
    assert found.stamps.rgb.seconds.tolist() == [1.25, 1.5, 2, 2.125]


def test_what_is_lost_is_left_out_and_said(tmp_path):
    matrices(written(tmp_path / "r"), np.where(np.arange(FRAMES)[:, None, None] == 1, np.nan, C2W))
    (tmp_path / "r/depth/3.png").unlink()
    found = stored_of(tmp_path / "r", PLAIN)
    np.testing.assert_allclose(found.trajectory.c2w, C2W[[0, 2]], rtol=0, atol=1e-12)
    assert any("1 of 3 frames have no valid pose" in note for note in found.notes)
    assert any("1 images are left out" in note for note in found.notes)
    kept = {"name": "kept", "poses": "keep", "sequence": {"folder": str(tmp_path / "r"), **PLAIN}}
    (scene,) = make_plan(read_preset(preset_of(tmp_path / "k", kept, output={"layout": "tum"}))).scenes
    assert scene.path.known.tolist() == [True, False, True]
    bare = {"rgb": "shots/*.png", "intrinsics": INTRINSICS}
    path = preset_of(
        tmp_path / "b", {"sequence": {"folder": str(tmp_path / "r"), **bare}}, output={"modalities": ["rgb"]}
    )
    stored = make_plan(read_preset(path)).scenes[0].source.stored
    assert (len(stored.trajectory), stored.trajectory.known.any(), stored.depth_files) == (FRAMES, False, ())


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("k.txt", "30 0 15.5\n0 29 12.25\n0 0 1\n"),
        ("k.txt", "30, 0, 15.5, 0\n0, 29, 12.25, 0\n0, 0, 1, 0\n0, 0, 0, 1\n"),
        ("k.txt", "30 29 15.5 12.25\n"),
        ("k.json", json.dumps({"K": [[30, 0, 15.5], [0, 29, 12.25], [0, 0, 1]]})),
        ("k.json", json.dumps({"intrinsic_matrix": [30, 0, 0, 0, 29, 0, 15.5, 12.25, 1], "width": 33, "height": 25})),
        ("k.json", json.dumps({"camera": {"w": 33, "h": 25, **INTRINSICS}})),
    ],
)
def test_intrinsics_are_read_from_what_tools_write(tmp_path, name, text):
    matrices(written(tmp_path / "r"))
    (tmp_path / "r" / name).write_text(text, encoding="utf-8-sig")
    sees_the_box(stored_of(tmp_path / "r", {**PLAIN, "intrinsics": name}), 1000)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rgb": None}, ("sequence.rgb: is missing", "rgb: {files: rgb/*.png}")),
        ({"rgb": "shot/*.png"}, ("rgb.files: no file matches", "folders there: depth", "shots")),
        ({"rgb": "shots/*.bmp"}, ("rgb.files: no file matches", "shots has files of .png")),
        ({"rgb": "**/*.png"}, ("rgb.files", "**")),
        ({"rgb": {"files": "shots/*.png", "list": "rgb.txt"}}, ("rgb: needs either files or list",)),
        ({"rgb": {"list": "poses.txt"}}, ("poses.txt: line 1", "not there")),
        ({"depth": {"files": "depth/*.png", "void": "none"}}, ("depth.void", "has to be a list")),
        ({"depth": {"files": "depth/*.png", "scale_per_m": 0}}, ("depth.scale_per_m", "allowed")),
        ({"poses": "truth.txt"}, ("poses.file: 'truth.txt' does not exist", "leave poses out")),
        ({"poses": {"file": "poses.txt", "axes": "nedd"}}, ("poses.axes", "ned")),
        ({"poses": {"file": "poses.txt", "format": "x" * 5000}}, ("poses.format", "unknown value", "5000 characters")),
        ({"rgb": "[!]"}, ("rgb.files", "is no pattern")),
        ({"imu": "x" * 5000}, ("sequence.imu", "does not exist", "5000 characters")),
        ({"intrinsics": {"fx": 30}}, ("intrinsics: needs either file, or fx, fy, cx and cy",)),
        ({"intrinsics": "poses.txt"}, ("poses.txt", "holds no intrinsics")),
        ({"stamps": "times.txt"}, ("times.txt", "has 1 times for 4 images")),
        ({"stamps": {"names": True, "file": "times.txt"}}, ("stamps: needs either",)),
        ({"folder": None}, ("sequence.folder: is missing",)),
        ({"colour": "x"}, ("sequence.colour: unknown key",)),
    ],
)
def test_what_is_wrong_is_one_line_with_file_key_and_remedy(tmp_path, change, said):
    matrices(written(tmp_path / "r"))
    (tmp_path / "r/times.txt").write_text("0.5\n")
    path = preset_of(tmp_path / "p", {"sequence": {"folder": str(tmp_path / "r"), **PLAIN, **change}})
    refused(lambda: make_plan(read_preset(path)), names=said)


def test_what_a_bag_says_itself_is_not_said_beside_it():
    place = ConfigPath("p.yaml", "sequence")
    topics = {
        "rgb": {"files": "/c"},
        "depth": {"files": "/d", "scale_per_m": 5000},
        "poses": {"file": "/p", "body": "b"},
    }
    check_sequence(parse(SequenceSpec, {"bag": "w.bag", **topics}, place), place)
    for name, said in {
        "folder": "r",
        "rgb": {"list": "rgb.txt"},
        "depth": {"files": "/d", "void": [1]},
        "poses": {"file": "/p", "axes": "ned"},
        "intrinsics": {"fx": 1, "fy": 1, "cx": 1, "cy": 1},
        "stamps": {"names": True},
    }.items():
        spec = parse(SequenceSpec, {"bag": "w.bag", name: said}, place)
        refused(check_sequence, spec, place, names=f"p.yaml: sequence.{'bag' if name == 'folder' else name}: ")


def test_colour_and_depth_that_cannot_be_paired_are_refused(tmp_path):
    matrices(written(tmp_path / "r", depth="depth/of_{n}.png"))
    (tmp_path / "r/depth/of_0.png").unlink()
    path = preset_of(tmp_path / "p", {"sequence": {"folder": str(tmp_path / "r"), **PLAIN}})
    refused(lambda: make_plan(read_preset(path)), names=("sequence.depth", "no name in common", "let * stand"))
    (tmp_path / "empty").mkdir()
    path = preset_of(tmp_path / "q", {"sequence": {"folder": str(tmp_path / "empty"), **PLAIN}})
    refused(lambda: make_plan(read_preset(path)), names=("rgb.files: no file matches", "empty"))
    cv2.imwrite(str(tmp_path / "r/shots/00.png"), colour(K, 0))
    path = preset_of(tmp_path / "s", {"sequence": {"folder": str(tmp_path / "r"), **PLAIN, "depth": None}})
    refused(lambda: make_plan(read_preset(path)), names=("00.png", "0.png", "stand for one frame"))


def test_a_described_recording_may_be_many(tmp_path):
    for name in ("one", "two"):
        (tmp_path / "takes").mkdir(exist_ok=True)
        matrices(written(tmp_path / "takes" / name))
    path = preset_of(tmp_path / "p", {"name": "take_*", "sequence": {"folder": str(tmp_path / "takes/*"), **PLAIN}})
    assert [scene.name for scene in make_plan(read_preset(path)).scenes] == ["take_one", "take_two"]
    changed = read_preset(
        path, ["scenes.0.sequence.depth.scale_per_m=500", f"scenes.0.sequence.folder={tmp_path}/takes/o*"]
    )
    (scene,) = make_plan(changed).scenes
    assert scene.source.stored.depth_scale_per_m == 500


def test_folders_of_colour_and_depth_are_found(tmp_path):
    written(tmp_path / "r", depth="depth/{n}.npy", make=lambda n: DEPTH_M[n].astype(np.float32))
    (tmp_path / "r/shots").rename(tmp_path / "r/color")
    (tmp_path / "r/color/notes.txt").write_text("a walk")
    found = find_sequence(tmp_path / "r")
    assert (len(found.rgb_files), found.trajectory.known.any(), found.depth_scale_per_m) == (FRAMES, False, 1.0)
    np.testing.assert_allclose(found.frame(2).depth_m, DEPTH_M[2], rtol=1e-6)
    path = preset_of(tmp_path / "p", {"name": "box", "sequence": str(tmp_path / "r")})
    refused(lambda: make_plan(read_preset(path)), names=("no file of", "intrinsics", "camera: {width: 33, height: 25"))
    (tmp_path / "r/intrinsic.txt").write_text("30 0 15.5\n0 29 12.25\n0 0 1\n")
    assert find_sequence(tmp_path / "r").known_camera.fy_px == 29
    matrices(tmp_path / "r", name="scan-traj.txt")  # now it is Redwood's
    refused(find_sequence, tmp_path / "r", names="0 depth images")


def test_lost_images_shift_no_pose(tmp_path):
    matrices(written(tmp_path / "r"))
    for name in ("shots/1.png", "depth/0.png"):
        (tmp_path / "r" / name).unlink()
    found = stored_of(tmp_path / "r", PLAIN)
    assert [path.stem for path in found.rgb_files] == ["2", "3"]
    np.testing.assert_allclose(found.trajectory.c2w, C2W[[2, 3]], rtol=0, atol=1e-12)
    for name in ("shots", "depth"):  # counted from 1, the first of which is lost
        for n in sorted((tmp_path / "r" / name).iterdir(), reverse=True):
            n.rename(n.with_stem(str(int(n.stem) + 1)))
        (tmp_path / "r" / name / "1.png").unlink(missing_ok=True)
    found = stored_of(tmp_path / "r", PLAIN)
    assert [path.stem for path in found.rgb_files] == ["3", "4"]
    np.testing.assert_allclose(found.trajectory.c2w, C2W[[2, 3]], rtol=0, atol=1e-12)
    matrices(tmp_path / "r", C2W[:2])  # as many as pairs: whose they are is not told otherwise
    np.testing.assert_allclose(stored_of(tmp_path / "r", PLAIN).trajectory.c2w, C2W[:2], rtol=0, atol=1e-12)


def test_floating_depth_in_a_list_is_metres(tmp_path):
    folder = written(tmp_path / "r", depth="depth/{n}.npy", make=lambda n: DEPTH_M[n].astype(np.float32))
    for kind, name in (("rgb", "shots/{n}.png"), ("depth", "depth/{n}.npy")):
        (folder / f"{kind}.txt").write_text("".join(f"{n} {name.format(n=n)}\n" for n in range(FRAMES)))
    found = find_sequence(folder, poses="none")
    np.testing.assert_allclose(found.frame(1).depth_m, DEPTH_M[1], rtol=1e-6)
    assert any("taken for metres" in str(note) for note in found.notes)
    camera = {"width": 33, "height": 25, **INTRINSICS}
    scene = {"name": "box", "sequence": str(folder), "poses": "none", "depth_scale_per_m": 2}
    path = preset_of(tmp_path / "p", scene, camera=camera, output={"layout": "tum"})
    (scene,) = make_plan(read_preset(path)).scenes
    np.testing.assert_allclose(scene.source.stored.frame(1).depth_m, DEPTH_M[1] / 2, rtol=1e-6)
