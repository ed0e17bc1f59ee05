# SPDX-License-Identifier: GPL-3.0-or-later
"""Out of a measured recording: a device and a setting that make clean frames into such ones, and severities."""

from dataclasses import replace

import pytest
import yaml
from refusals import refused
from test_noise import COUNT, HIGH, WIDE, walls

from noisy_world.cli import command
from noisy_world.core.geometry import Intrinsics
from noisy_world.dataset.plan import make_plan
from noisy_world.measure.depth_noise import depth_noise
from noisy_world.measure.figure import Figure
from noisy_world.measure.looking import RecordingFigures
from noisy_world.measure.twin import places, twin_of
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.preset.keys import check_document, read_preset

CAMERA = Intrinsics(WIDE, HIGH, 150.0, 150.0, (WIDE - 1) / 2, (HIGH - 1) / 2)
STRAIGHT = {"from_m": 0.0, "linear": 0.0, "steep": 0.0, "lateral_px": 0.0, "lateral_steep_px": 0.0}
LAW = STRAIGHT | {"offset_m": 0.001, "quadratic_per_m": 0.002}
PATCHES = {"correlation_px": 3.0, "correlation_share": 0.7, "correlation_frames": 4}
DISPARITY = {"focal_px": 150.0, "baseline_m": 0.001, "step_px": 0.0006, "sigma_px": 0.0002, "window_px": 0.0}
DISPARITY |= {"least_share": 0.0, "shift_px": 0.0, "min_m": 0.0, "max_m": 1000.0}


def found_of(*figures):
    """Findings with figures alone."""
    return RecordingFigures("walk", COUNT, (WIDE, HIGH), 1.0, COUNT, {figure.name: figure for figure in figures})


def seen_by(sensor, who):
    """What is measured of slanted walls that a sensor sees: one perturbation of depth with its parameters."""
    ((name, values),) = sensor.items()
    model = registry()[name]
    looks = walls(lambda z: 0 * z)
    for frame, look in enumerate(looks):
        context = FrameContext(frame, (who,), intrinsics=CAMERA)
        looks[frame] = replace(look, depth_m=model.apply(look.depth_m, model.parameters(**values), context))
    return depth_noise(looks, range(COUNT))


@pytest.mark.parametrize(
    "sensor",
    [{"axial_noise": LAW}, {"axial_noise": LAW | PATCHES}, {"structured_light": DISPARITY}],
    ids=["law", "patches", "steps"],
)
def test_a_twin_measures_as_its_original_does(sensor):
    known = seen_by(sensor, "original")
    twin = twin_of(found_of(*known.figures), CAMERA, None)
    assert list(twin.sensor) == list(sensor)
    again = seen_by(twin.sensor, "twin")
    for (_, one), (_, other) in zip(known.curve, again.curve, strict=True):
        assert other.value == pytest.approx(one.value, rel=0.1)
    for one, other in zip(known.correlation, again.correlation, strict=True):
        assert other.value == pytest.approx(one.value, abs=0.1)
    assert again.steps[0].value == known.steps[0].value or again.steps[0].value == pytest.approx(
        known.steps[0].value, rel=0.1
    )


@pytest.mark.parametrize(("px", "share", "frames"), [(3.0, 0.7, 4), (4.0, 0.62, 6)])
def test_patches_come_back(px, share, frames):
    known = LAW | {"correlation_px": px, "correlation_share": share, "correlation_frames": frames}
    axial = twin_of(found_of(*seen_by({"axial_noise": known}, "known").figures), CAMERA, None).sensor["axial_noise"]
    assert axial["quadratic_per_m"] == pytest.approx(0.002, rel=0.1)
    assert axial["correlation_px"] == pytest.approx(px, rel=0.15)
    assert axial["correlation_share"] == pytest.approx(share, abs=0.1)
    assert abs(axial["correlation_frames"] - frames) <= 1


def test_a_disparity_comes_back():
    stepped = twin_of(found_of(*seen_by({"structured_light": DISPARITY}, "known").figures), CAMERA, None).sensor
    assert stepped["structured_light"]["step_px"] == pytest.approx(0.0006, rel=0.05)
    assert stepped["structured_light"]["sigma_px"] == pytest.approx(0.0002, rel=0.15)


def test_colour_holes_and_lateness_become_steps_and_what_is_untold_is_said():
    found = found_of(
        Figure.exact("colour_gaussian_std", 0.03, 9),
        Figure.exact("colour_variance_per_intensity", 1 / 80, 9),
        *(Figure.exact(f"holes_{where}_share", 0.02, 9) for where in ("at_border", "in_dark", "elsewhere")),
        Figure.exact("depth_late_frames", 2.1, 9),
        Figure.none("depth_noise_offset_m", "planes are seen at too few distances"),
    )
    twin = twin_of(found, CAMERA, None)
    assert twin.colour == [{"gaussian_noise": {"std": 0.03}}, {"shot_noise": {"photons": 80.0}}]
    assert twin.holes == [{"depth_random_missing": {"missing_percent": 6.0}}]
    assert twin.pairing == [{"desync": {"offset": -2}}]
    assert twin.sensor is None
    assert any("depth_noise_offset_m" in line and "too few distances" in line for line in twin.untold)


@pytest.mark.parametrize("severity", [1.4, 2.0, 3.7, 4.5])
@pytest.mark.parametrize(
    ("figure", "perturbation", "parameter"),
    [
        ("colour_gaussian_std", "gaussian_noise", "std"),
        ("colour_variance_per_intensity", "shot_noise", "photons"),
        ("void_share", "depth_random_missing", "missing_percent"),
    ],
)
def test_a_place_on_the_severities_is_the_inverse_of_what_they_mean(figure, perturbation, parameter, severity):
    value = getattr(registry()[perturbation].at_severity(severity), parameter)
    value = {"photons": 1 / value, "missing_percent": value / 100}.get(parameter, value)
    (place,) = places(found_of(Figure.exact(figure, value, 9)))
    assert (place.perturbation, place.severity) == (perturbation, pytest.approx(severity))


def test_places_below_and_beyond_the_severities():
    (below,) = places(found_of(Figure.exact("colour_gaussian_std", 0.02, 9)))  # severity 1 is 0.08
    assert below.severity == pytest.approx(0.25)
    (beyond,) = places(found_of(Figure.exact("colour_gaussian_std", 0.76, 9)))  # severity 5 is 0.38
    assert (beyond.severity, beyond.times) == (5.0, pytest.approx(2.0))
    # Nguyen's law at 2 m: 1.2 mm and 1.9 mm times 1.6^2; the model's severity 3.
    law = (Figure.exact("depth_noise_offset_m", 0.0012 + 0.0019 * 1.6**2, 9),)
    (model,) = places(found_of(*law, Figure.exact("depth_noise_quadratic_per_m", 0.0, 9)))
    assert (model.perturbation, model.severity) == ("axial_noise", pytest.approx(3.0))


# --- files ---

DEVICE = {
    "camera": {
        "width": 320,
        "height": 240,
        "fx": 250.0,
        "fy": 251.0,
        "cx": 159.5,
        "cy": 119.5,
        "distortion": {"k1": 0.1},
    },
    "depth": {"axial_noise": LAW},
    "perturb": [{"gaussian_noise": {"std": 0.03}}, {"shot_noise": {"photons": 80}}],
}
PRESET = {
    "scenes": [{"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 4}}}],
    "camera": {"device": "./measured.yaml", "width": 640},
    "render": {"engine": "embree", "backend": "reference"},
    "rig": {"depth": {"sensor": "./measured.yaml"}},
    "settings": [{"name": "seen", "perturb": [{"device": "measured.yaml"}, {"pixelate": {"severity": 1}}]}],
}


def written(folder, device=None, preset=PRESET):
    """The preset's file, beside that of a device."""
    (folder / "measured.yaml").write_text(yaml.safe_dump(DEVICE if device is None else device))
    (folder / "preset.yaml").write_text(yaml.safe_dump(preset))
    return folder / "preset.yaml"


def test_a_preset_takes_what_a_devices_file_says(tmp_path):
    taken = read_preset(written(tmp_path))
    said = PRESET | {
        "camera": {"width": 640, "height": 480, "fx": 500.0, "fy": 502.0, "cx": 319.5, "cy": 239.5},
        "rig": {"depth": {"sensor": DEVICE["depth"]}},
        "settings": [{"name": "seen", "perturb": [*DEVICE["perturb"], {"pixelate": {"severity": 1}}]}],
    }
    said["camera"]["distortion"] = {"k1": 0.1}
    (tmp_path / "said.yaml").write_text(yaml.safe_dump(said))
    one, other = make_plan(taken), make_plan(read_preset(tmp_path / "said.yaml"))
    assert one.settings == other.settings
    assert one.cameras == other.cameras
    assert taken.spec.camera == other.preset.spec.camera
    # All that decides bytes stands in the document, as a recipe has it: the file may go.
    assert "measured.yaml" not in str(taken.described)
    (tmp_path / "measured.yaml").unlink()
    assert make_plan(check_document(taken.described, tmp_path / "recipe.yaml")).settings == one.settings
    changed = DEVICE | {"depth": {"axial_noise": LAW | {"offset_m": 0.002}}}
    assert read_preset(written(tmp_path, changed)).sha256 != taken.sha256


def test_parts_of_a_devices_file_are_changed_or_left_out(tmp_path):
    step = {"device": {"name": "measured.yaml", "shot_noise": False, "gaussian_noise": {"std": 0.06}}}
    preset = PRESET | {"settings": [{"name": "seen", "perturb": [step]}]}
    (setting,) = make_plan(read_preset(written(tmp_path, preset=preset))).settings
    assert [(each.perturbation.name, each.given) for each in setting.steps] == [("gaussian_noise", {"std": 0.06})]
    step["device"] = {"name": "measured.yaml", "shot_nose": False}
    names = ("preset.yaml", "settings.0.perturb.0.device.shot_nose", "shot_noise")
    refused(read_preset, written(tmp_path, preset=preset), names=names)


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"depth": None}, ("measured.yaml", "depth", "is missing", "rig.depth.sensor", "--device")),
        ({"camera": {"width": 320}}, ("measured.yaml", "camera.height", "add it")),
        ({"camera": DEVICE["camera"] | {"fx": -1}}, ("measured.yaml", "camera.fx", "allowed")),
        ({"lens": {}}, ("measured.yaml", "unknown key", "lens")),
        ({"depth": {"axial_noise": {"offset_m": "much"}}}, ("measured.yaml", "depth.axial_noise.offset_m", "number")),
        ({"depth": {"axial_nose": {}}}, ("measured.yaml", "depth", "axial_noise")),
        ({"depth": "kinect_v1"}, ("measured.yaml", "depth", "write {axial_noise")),
        ({"perturb": [{"gaussian_noise": {"sd": 0.1}}]}, ("measured.yaml", "perturb.0.gaussian_noise.sd", "std")),
        ({"perturb": [{"device": "measured.yaml"}]}, ("measured.yaml", "perturb.0.device", "camera")),
    ],
)
def test_a_wrong_devices_file_is_refused_by_its_name_and_key(tmp_path, change, names):
    refused(lambda file: make_plan(read_preset(file)), written(tmp_path, DEVICE | change), names=names)


def test_a_devices_file_that_is_not_there_is_refused(tmp_path):
    file = written(tmp_path)
    (tmp_path / "measured.yaml").unlink()
    refused(read_preset, file, names=("preset.yaml", "camera.device", "is not there", "measure --device"))


def test_the_command_writes_both_files_once(walk, tmp_path, capsys):
    device, preset = tmp_path / "measured.yaml", tmp_path / "twin.yaml"
    words = ["measure", str(walk / "noisy/room"), "--device", str(device), "--preset", str(preset)]
    assert command.main(words) == 0
    assert "severity   axial_noise" in capsys.readouterr().out
    only_depth = {"camera": {"device": "measured.yaml"}, "settings": [{"name": "clean"}]}
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump(PRESET | only_depth))
    assert make_plan(read_preset(tmp_path / "preset.yaml")).cameras["room"].width_px == 240
    (twin,) = (setting for setting in make_plan(read_preset(preset)).settings if setting.name == "twin")
    # A Kinect's disparity in eighths of a pixel; texture hides the noise of colour.
    assert "structured_light" in [step.perturbation.name for step in twin.steps]
    assert "# colour_gaussian_std: cannot be told here, because" in preset.read_text()
    before = device.read_bytes()
    assert command.main(words) == 1
    assert "is there already" in capsys.readouterr().err
    assert device.read_bytes() == before
