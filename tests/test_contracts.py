# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything of ours keeps the contracts that authors test theirs with; what breaks a rule is told which."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from pose_texts import NS, POSITIONS, QUATS, blocks, colmap_text, expected, open3d_text, rows, saved
from recorded_layouts import WRITERS, rgbd_folders

from noisy_world import testing
from noisy_world.channels import CHANNELS, COLOUR_AND_DEPTH
from noisy_world.evaluate.map_metrics import MAP_METRICS, MapMetric
from noisy_world.evaluate.metrics import METRICS
from noisy_world.evaluate.systems import SHIPPED
from noisy_world.extend import (
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    MotionPerturbation,
    PairingPerturbation,
    Shutter,
    TrajectoryMetric,
    key,
)
from noisy_world.layouts import LAYOUTS, RECORDED
from noisy_world.layouts.replica import ReplicaLayout
from noisy_world.layouts.tum import TumLayout
from noisy_world.perturbations import registry
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS


@pytest.mark.parametrize("name", [name for name, item in registry().items() if item.distribution is None])
def test_perturbations_keep_theirs(name):
    testing.check_perturbation(registry()[name])


@pytest.mark.parametrize("name", list(METRICS))
def test_metrics_keep_theirs(name):
    testing.check_metric(METRICS[name])


@pytest.mark.parametrize("name", list(MAP_METRICS))
def test_map_metrics_keep_theirs(name):
    pytest.importorskip("embreex", reason="embreex comes with the extra evaluate")
    testing.check_map_metric(MAP_METRICS[name])


@pytest.mark.parametrize("name", list(LAYOUTS))
def test_layouts_keep_theirs(name, tmp_path):
    testing.check_layout(LAYOUTS[name], tmp_path)


@pytest.mark.parametrize("name", list(RECORDED))
def test_layouts_of_recordings_keep_theirs(name, tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    {**WRITERS, "rgbd_folders": rgbd_folders}[name](folder)
    testing.check_layout(RECORDED[name], folder)


POSES = {
    "replica": lambda: "".join(text.replace("\n", " ") + "\n" for text in blocks()),
    "kitti": lambda: "".join(" ".join(text.split()[:12]) + "\n" for text in blocks()),
    "tum": lambda: rows([0.1, 0.2, 0.3, 0.4], "pxyzw", " "),
    "euroc": lambda: rows(NS),
    "matrices": lambda: "".join(blocks()),
    "log": lambda: "".join(f"{k} {k} {k + 1}\n{text}" for k, text in enumerate(blocks())),
    "transforms": lambda: json.dumps({"frames": [{"transform_matrix": pose.tolist()} for pose in expected()]}),
    "kitti360": lambda: "".join(f"{3 * k} " + text.replace("\n", " ") + "\n" for k, text in enumerate(blocks())),
    "vslamlab": lambda: "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n" + rows(NS, "pxyzw"),
    "tartanair": lambda: "".join(row.partition(" ")[2] + "\n" for row in rows(NS, "pxyzw", " ").splitlines()),
    "open3d": lambda: open3d_text(expected()),
    "colmap": lambda: colmap_text(QUATS, POSITIONS),
    "array": lambda: saved(np.save, expected()),
    "splatam": lambda: saved(np.savez, cam_unnorm_rots=QUATS.T[None], cam_trans=POSITIONS.T[None]),
}


@pytest.mark.parametrize("name", list(TRAJECTORY_FORMATS))
def test_trajectory_formats_keep_theirs(name, tmp_path):
    content = POSES[name]()
    (file := tmp_path / "poses").write_bytes(content if isinstance(content, bytes) else content.encode())
    testing.check_trajectory_format(TRAJECTORY_FORMATS[name], file, tmp_path)


@pytest.mark.parametrize("name", [name for name in CHANNELS if name not in {*COLOUR_AND_DEPTH, "passes"}])
def test_channels_keep_theirs(name):
    testing.check_channel(CHANNELS[name])


def test_a_system_keeps_its(tmp_path):
    testing.check_system(SHIPPED / "plain_odometry.yaml", tmp_path)


# --- what breaks a rule ---


@dataclass(frozen=True)
class Amount:
    """How much."""

    amount: float = key("how much", default=0.3, minimum=0, maximum=1)


USUAL = {"label": "Broken", "order": 1, "parameters": Amount, "source": "none"}
LEVELS = {"severities": {"amount": (0.1, 0.2, 0.3, 0.4, 0.5)}}


def colour(apply, **keys):
    return ColourPerturbation(name="broken", stage="lens", apply=apply, **{**USUAL, **LEVELS, **keys})


def depth(apply, **keys):
    return DepthPerturbation(name="broken", apply=apply, **{**USUAL, **LEVELS, **keys})


def darken(rgb, parameters, context):
    rgb *= np.float32(parameters.amount)
    return rgb


def unseeded(rgb, parameters, context):
    return (rgb + np.random.default_rng().standard_normal(rgb.shape) * parameters.amount).astype(np.float32)


def noisy(rgb, parameters, context):
    return (rgb + context.stream().standard_normal(rgb.shape) * parameters.amount).astype(np.float32)


def turned(trajectory, parameters, context):
    return replace(trajectory, c2w=trajectory.c2w * 2)


def averaged(take, parameters):
    shown = [take(seconds) for seconds in (0.0, parameters.amount)]
    return tuple(np.mean([getattr(item, name) for item in shown], axis=0) for name in ("rgb", "depth_m"))


def exposure(apply):
    shutter = lambda parameters: Shutter(0.0, parameters.amount)  # noqa: E731
    return ExposurePerturbation(name="exposing", apply=apply, shutter=shutter, **USUAL, **LEVELS)


def test_an_exposure_keeps_its_contract():  # none is shipped
    testing.check_perturbation(exposure(averaged))


FEWER = {"amount": (0.1, 0.2, 0.4, 0.5, 0.6)}


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (colour(noisy, severities=FEWER), "the default of amount is 0.3, but severity 3 says 0.4"),
        (colour(darken), "writes into what it is given"),
        (colour(unseeded), "gives another colour for the same frame; draw from the context only"),
        (colour(noisy, repeatable=True), "says repeatable, but frames 4 and 5 differ for equal images"),
        (colour(lambda rgb, *_: rgb), "returns the array that it is given; return a new one"),
        (colour(noisy, apply_bytes=lambda rgb, *_: rgb + np.uint8(1)), "apply_bytes gives other bytes than apply, r"),
        (colour(lambda rgb, *_: rgb / np.float32(0) * 0), "gives colour that is not finite"),
        (colour(lambda rgb, *_: rgb[::2]), "apply has to return a float32 array of shape (36, 48, 3)"),
        (depth(lambda depth_m, *_: depth_m + np.float32(0.1)), "gives depth where there was none; void (0) has"),
        (depth(lambda depth_m, *_: -depth_m), "gives depth of -"),
        (MotionPerturbation(name="broken", apply=turned, **USUAL, severities={}), "gives poses that are not rigid"),
        (
            PairingPerturbation(name="broken", apply=lambda count, *_: np.arange(count) + 1, **USUAL, severities={}),
            "has to name frames from 0 to 11, or -1, not [12]",
        ),
        (exposure(lambda take, _: (take(0.0).rgb, None)), "exposing: leaves out an image that it is given"),
        (exposure(lambda take, _: (take(0.0).rgb[::2], take(0.0).depth_m)), "makes colour of (18, 48, 3) of"),
        (Amount(), "is a Amount, no perturbation"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_a_broken_perturbation_is_told_its_rule(broken, told):
    with pytest.raises(AssertionError) as raised:
        testing.check_perturbation(broken)
    assert told in str(raised.value)


def metric(compute, name="broken_m", unit="m", better="lower", meaning="A number.", **keys):
    return TrajectoryMetric(name, "broken", unit, better, meaning, compute, **keys)


def moved(compared):
    compared.estimate[:, 0, 3] = 0.0
    return 0.0


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (metric(lambda compared: 1.0), "is 1 for an estimate that is the truth, but lower is better: 0"),
        (metric(lambda compared: 0.0, name="broken"), "is in m, so its name has to end with _m"),
        (metric(lambda compared: 0.0, meaning="a number"), "its meaning has to be a sentence"),
        (metric(moved), "changes the poses that it is given; copy them"),
        (metric(lambda compared: float(np.random.default_rng().random()) * 1e-9), "for the same poses"),
        (metric(lambda compared: -compared.ate_m), "better than the truth"),
        (metric(lambda compared: None), "has no value for an estimate that is the truth"),
        (metric(lambda compared: float(len(compared.frames) < 60), better="higher"), "and higher is better"),
        (metric(lambda compared: compared.position.rmse if compared.by else float("nan"), of_failed=True), "gave nan"),
    ],
)  # fmt: skip
def test_a_broken_metric_is_told_its_rule(broken, told):
    with pytest.raises(AssertionError) as raised:
        testing.check_metric(broken)
    assert told in str(raised.value)


def of_map(compute, name="broken_m", better="lower", meaning="A number."):
    return MapMetric(name, "broken", "m", better, meaning, compute)


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (of_map(lambda compared: 0.0, name="broken"), "is in m, so its name has to end with _m"),
        (of_map(lambda compared: 0.0, meaning="a number"), "its meaning has to be a sentence"),
        (of_map(lambda compared: float("nan")), "the metric broken_m gave nan"),
        (of_map(lambda compared: float(np.random.default_rng().random())), "for the same map"),
        (
            of_map(lambda compared: float(compared.map is not None)),
            "is 0 for no map, better than 1 for the truth",
        ),
        (
            of_map(lambda compared: None if compared.accuracy_m is None else -float(compared.accuracy_m.mean())),
            "for half of the truth, better than -0 for the truth itself: lower is better",
        ),
    ],
)
def test_a_broken_metric_of_maps_is_told_its_rule(broken, told):
    pytest.importorskip("embreex", reason="embreex comes with the extra evaluate")
    with pytest.raises(AssertionError) as raised:
        testing.check_map_metric(broken)
    assert told in str(raised.value)


class Counting(ReplicaLayout):
    """Finds no frames.jsonl."""

    def read(self, folder, rate_hz=None, poses="drop"):
        found = super().read(folder, rate_hz, poses)
        counted = found.stamps.of(np.arange(len(found.rgb_files)) / 20)
        return replace(found, stamps=counted, trajectory=found.trajectory.at(slice(None), counted.rgb.seconds))


class Unremoved(ReplicaLayout):
    """Writes what none of its patterns matches."""

    def sequence_texts(self, facts):
        return {**super().sequence_texts(facts), "notes.txt": "!"}


class OneName(ReplicaLayout):
    """Gives every image of depth one name."""

    def depth_name(self, frame, stamp_ns):
        return "results/depth000000.png"


class Scaled(TumLayout):
    """Reads its own depth scale, whatever was written."""

    name = "scaled"

    def read(self, folder, rate_hz=None, poses="drop"):
        return replace(super().read(folder, rate_hz, poses), depth_scale_per_m=self.depth_scale_per_m)


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (Counting, "where no file of its own says them, they are in frames.jsonl"),
        (Unremoved, "writes notes.txt, which none of its patterns matches: it would never be removed"),
        (OneName, "gives two images one name"),
        (Scaled, "its files are recognised by tum too; tell it by what others do not have"),
    ],
)
def test_a_broken_layout_is_told_its_rule(broken, told, tmp_path):
    with pytest.raises(AssertionError) as raised:
        testing.check_layout(broken(), tmp_path)
    assert told in str(raised.value)


class Steps(type(CHANNELS["normal"])):
    def steps_of(self, pixels):
        return super().steps_of(pixels).astype(np.int32)


class Void(type(CHANNELS["normal"])):
    def of_mesh(self, mesh):
        made = super().of_mesh(mesh)
        return lambda surface: made(surface) + np.linspace(0, 1, 48, dtype=np.float32)[:, None]


class Numbers(type(CHANNELS["instance"])):
    kinds = ("png", "exr")


class Wide(type(CHANNELS["instance"])):
    components = 3


class Changing(type(CHANNELS["normal"])):
    def of_mesh(self, mesh):
        return lambda surface: np.negative(surface.normals, out=surface.normals)


class Lost(type(CHANNELS["flow"])):
    def stored(self, pixels, kind):
        return np.rint(pixels)


class Nameless(type(CHANNELS["flow"])):
    parts = ("dx", "dy")


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (Steps, "normal: its steps are int32 (36, 48, 3), not uint16 (36, 48, 3)"),
        (Void, "normal: has several values for what is void, of a surface"),
        (Numbers, "instance: is uint16, and an EXR holds float32: leave exr out of kinds"),
        (Wide, "instance: its image of a surface is uint16 (36, 48), but it says uint16 (36, 48, 3)"),
        (Changing, "normal: changes what it is given; copy it"),
        (Lost, "flow: reads another image from its exr file than `stored` says, of two frames"),
        (Nameless, "flow: names 2 parts of 3 components"),
    ],
)
def test_a_broken_channel_is_told_its_rule(broken, told):
    with pytest.raises(AssertionError) as raised:
        testing.check_channel(broken())
    assert told in str(raised.value)


SYSTEM = """name: {name}
about: {about}
command: ["{{python}}", "-c", "import sys; {program}", "{{frames}}"]
writes: {{file: poses.txt, format: tum}}
"""
WRITES = "open('poses.txt', 'w').writelines('%d.5 %d 0 0 0 0 0 1' % (k, k) + chr(10) for k in range(9))"

ONE = "open('poses.txt', 'w').write('10.0 0 0 0 0 0 0 1' + chr(10))"


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"name": "other"}, "other: its file is named broken.yaml; name it other.yaml"),
        ({"about": "words"}, "about has to be a sentence"),
        ({"program": "sys.exit(3)"}, "broken: a run ended as crashed"),
        ({"program": WRITES}, "0 of its 9 poses have the stamp of a frame; 3 or more have to: see writes.stamps"),
        ({"program": ONE}, "broken: 1 of its 1 poses have the stamp of a frame; 3 or more have to"),
    ],
)  # fmt: skip
def test_a_broken_system_is_told_its_rule(keys, told, tmp_path):
    definition = tmp_path / "broken.yaml"
    definition.write_text(SYSTEM.format(**{"name": "broken", "about": "It is broken.", "program": WRITES, **keys}))
    with pytest.raises(AssertionError) as raised:
        testing.check_system(definition, tmp_path / "work")
    assert told in str(raised.value)
