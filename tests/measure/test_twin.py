# SPDX-License-Identifier: GPL-3.0-or-later
"""Out of a measured recording: a device and a setting that make clean frames into such ones, and severities."""

from dataclasses import replace
from pathlib import Path

import numpy as np
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
from noisy_world.measure.severities import places
from noisy_world.measure.twin import preset_text, twin_of
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


def test_colour_and_lateness_become_steps_and_what_is_untold_is_said():
    found = found_of(
        Figure.exact("colour_gaussian_std", 0.03, 9),
        Figure.exact("colour_variance_per_intensity", 1 / 80, 9),
        Figure.exact("depth_late_frames", 2.1, 9),
        Figure.none("depth_noise_offset_m", "planes are seen at too few distances"),
    )
    twin = twin_of(found, CAMERA, None)
    assert twin.colour == [{"gaussian_noise": {"std": 0.03}}, {"shot_noise": {"photons": 80.0}}]
    assert twin.pairing == [{"desync": {"offset": -2}}]
    assert twin.sensor is None
    assert any("depth_noise_offset_m" in line and "too few distances" in line for line in twin.untold)


def test_holes_and_places_become_the_sensors():
    holes = (Figure.exact("hole_least_light", 0.02, 9), Figure.exact("hole_light_spread", 1.5, 9))
    holes += (Figure.exact("hole_clump_px", 20.0, 9), Figure.exact("hole_clump_frames", 3.6, 9))
    holes += (Figure.exact("border_right_px", 8.0, 9), Figure.exact("border_top_px", 2.0, 9))
    lost = {"least_light": 0.02, "reflectance_spread": 1.5, "clump_px": 20.0, "clump_frames": 4}
    lost |= {"blind_px": 8.0, "blind_top_px": 2.0}
    alone = twin_of(found_of(*holes), CAMERA, None).sensor["axial_noise"]
    assert alone.items() >= (lost | {"offset_m": 0.0, "quadratic_per_m": 0.0}).items()
    law = {"offset_m": 0.001, "quadratic_per_m": 0.002, "head_on_offset_m": 0.0, "head_on_quadratic_per_m": 0.0015}
    figures = [Figure.exact(f"depth_noise_{name}", value, 9) for name, value in law.items()]
    figures += [Figure.exact("depth_shift_px", 0.9, 9), Figure.exact("shadow_baseline_m", 0.05, 9)]
    twin = twin_of(found_of(*figures, *holes), CAMERA, None)
    axial = twin.sensor["axial_noise"]
    # Whole pixels deviate by a twelfth more in square, and planes over 9 x 9 pixels leave all of what is each pixel's.
    assert axial["lateral_px"] == pytest.approx(np.sqrt(0.81 - 1 / 12), rel=0.01)
    assert axial["quadratic_per_m"] == pytest.approx(0.0015, rel=0.02)
    assert any("shadow_baseline_m" in line for line in twin.untold)
    stepped = twin_of(found_of(*figures, *holes, Figure.exact("depth_step_per_m", 0.003, 9)), CAMERA, None)
    kinect = stepped.sensor["structured_light"]
    assert kinect.items() >= (lost | {"baseline_m": 0.05}).items()
    assert kinect["shift_px"] == axial["lateral_px"]


def test_shutter_lens_light_files_and_clocks_become_steps():
    found = found_of(
        Figure.exact("rate_hz", 20.0, 9),
        Figure("exposure_ms", 12.0, 10.0, 14.0),
        Figure("readout_down_ms", -20.0, -21.0, -19.0),
        Figure("readout_right_ms", 0.3, -1.0, 1.6),
        Figure("defocus_sigma_px", 1.5, 1.3, 1.7),
        Figure("vignetting_corner_loss", 0.4, 0.3, 0.5),
        Figure("exposure_range_stops", 1.2, 1.0, 1.4),
        Figure.exact("exposure_rate_stops_per_s", 2.0, 9),
        Figure.exact("mean_light", 0.2, 9),
        Figure("white_balance_range_stops", 0.4, 0.3, 0.5),
        Figure("flicker_swing_120_hz", 0.1, 0.08, 0.12),
        Figure("column_noise_std", 0.01, 0.008, 0.012),
        Figure.exact("colour_gaussian_std", 0.03, 9),
        Figure.exact("jpeg_quality", 80, 9),
        Figure.exact("jpeg_420_share", 0.0, 9),
        Figure("depth_late_frames", 1.4, 1.3, 1.5),
        Figure.exact("gyro_noise_density", 0.001, 9),
        Figure.exact("gyro_rest_noise_density", 0.002, 9),
        Figure.exact("gyro_bandwidth_hz", 64.0, 9),
        Figure.exact("accel_bandwidth_hz", 120.0, 9),
        Figure("imu_clock_drift_ppm", 50.0, 40.0, 60.0),
        Figure("imu_clock_s", 0.02, 0.015, 0.025),
        Figure("imu_clock_by_poses_s", 0.021, 0.02, 0.022),
        Figure.exact("jitter_s", 0.001, 9),
        Figure.exact("missing_frames", 4, 9),
        Figure.exact("doubled_share", 0.1, 9),
        Figure.exact("doubled_depth_share", 0.08, 9),
    )
    twin = twin_of(found, CAMERA, None)
    assert twin.shutter == [
        {"camera_motion_blur": {"shutter_ms": 12.0}},
        {"rolling_shutter": {"readout_ms": 20.0, "direction": "up"}},
    ]
    # Lamps of 120 Hz that are seen for 12 ms: sinc(1.44) of the swing is left.
    left = abs(np.sinc(1.44))
    assert twin.colour == [
        {"gaussian_blur": {"sigma_px": 1.5}},
        {"vignetting": {"corner_loss": 0.4}},
        {"auto_exposure": {"target": 0.2, "lag_s": 0.6}},
        {"flicker": {"mains_hz": 60, "modulation": pytest.approx(0.1 / left, rel=0.01)}},
        {"gaussian_noise": {"std": 0.03}},
        {"jpeg_compression": {"quality": 80}},
    ]
    assert twin.delay_ms == -70.0
    assert COUNT == 16
    assert twin.pairing == [{"desync": {"offset": 0, "lost_percent": 20.0, "repeated_percent": 8.0}}]
    late = twin_of(
        found_of(Figure("depth_late_frames", 3.0, 2.9, 3.1), Figure.exact("missing_frames", 4, 9)), CAMERA, None
    )
    assert late.pairing == [{"desync": {"offset": -3, "lost_percent": 20.0}}]
    clock = {"time_offset_s": 0.021, "clock_drift_ppm": 50.0}
    assert twin.imu == {"gyro_noise_density": 0.002, "bandwidth_hz": 64.0} | clock
    assert any("accel_bandwidth_hz" in line for line in twin.untold)
    for name in ("white_balance_range_stops", "column_noise_std", "jpeg_420_share", "jitter_s", "doubled_share"):
        assert any(line.startswith(name) for line in twin.untold)
    (setting,) = (
        each for each in check_document(yaml.safe_load(preset_text(twin, found)), Path("t")).spec.settings[1:]
    )
    assert setting.name == "twin"
    assert "rig.depth.delay_ms" not in str(setting.perturb)


def test_rows_and_hot_pixels_are_a_sensors():
    light = 0.2  # 0.4845 encoded, by IEC 61966-2-1
    known = Figure("row_noise_std", 0.02, 0.019, 0.021), Figure("hot_pixel_share", 0.01, 0.009, 0.011)
    (step,) = twin_of(found_of(*known, Figure.exact("mean_light", light, 9)), CAMERA, None).colour
    model = registry()["sensor_noise"]
    image = np.full((300, 200, 3), 0.4845, np.float32)
    made = model.apply(image, model.parameters(**step["sensor_noise"]), FrameContext(0, (1, "sensor")))
    assert np.median(made, axis=1).std(axis=0) == pytest.approx(0.02, rel=0.15)
    over = made - np.median(made, axis=1, keepdims=True)
    assert (over > 8 / 255).any(axis=2).mean() == pytest.approx(0.01, rel=0.15)


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


@pytest.mark.parametrize(
    ("figure", "value", "perturbation", "severity"),
    [
        ("vignetting_corner_loss", 0.35, "vignetting", 2),
        ("exposure_ms", 20.0, "camera_motion_blur", 3.5),
        ("readout_down_ms", -10.0, "rolling_shutter", 2),
        ("flicker_swing_100_hz", 0.025, "flicker", 0.5),
        ("jpeg_quality", 16.5, "jpeg_compression", 2.5),
        ("jpeg_quality", 75, "jpeg_compression", 0.25),  # libjpeg: 200 - 2 x 75 per cent, of 5000 / 25
    ],
)
def test_places_on_other_severities(figure, value, perturbation, severity):
    (place,) = places(found_of(Figure(figure, value, value - 1, value + 1)))
    assert (place.perturbation, place.severity) == (perturbation, pytest.approx(severity))
    assert place.low <= place.severity <= place.high


@pytest.mark.parametrize("severity", [1, 3, 5])
def test_blurs_are_placed_by_what_they_spread_of_a_point(severity):
    point = np.zeros((81, 81, 3), np.float32)
    point[40, 40] = 1

    def deviation_px(name, **given):
        model = registry()[name]
        spread = model.apply(point, model.at_severity(severity, **given), FrameContext(0, (1,)))[..., 1].sum(axis=0)
        at = np.arange(81)
        mean = spread @ at / spread.sum()
        return float(np.sqrt(spread @ (at - mean) ** 2 / spread.sum()))

    way_px = 12**0.5 * deviation_px("motion_blur", max_angle_deg=0)
    (moved,) = places(found_of(Figure.exact("motion_blur_most_px", way_px, 9)))
    assert (moved.perturbation, moved.severity) == ("motion_blur", pytest.approx(severity, abs=0.02))
    assert "one edge in twenty" in str(moved)
    sigma_px = deviation_px("defocus_blur")
    (lens,) = places(found_of(Figure.exact("defocus_sigma_px", sigma_px, 9)))
    assert (lens.perturbation, lens.severity) == ("defocus_blur", pytest.approx(severity, abs=0.15))


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
    "delay_ms": 12.5,
    "imu": {"gyro_noise_density": 0.001, "time_offset_s": 0.01},
    "perturb": [{"gaussian_noise": {"std": 0.03}}, {"shot_noise": {"photons": 80}}],
}
PRESET = {
    "scenes": [{"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 4}}}],
    "camera": {"device": "./measured.yaml", "width": 640},
    "render": {"engine": "embree", "backend": "reference"},
    "rig": {"depth": {"sensor": "./measured.yaml"}, "imu": {"device": "./measured.yaml", "time_offset_s": 0.0}},
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
        "rig": {
            "depth": {"sensor": DEVICE["depth"], "delay_ms": 12.5},
            "imu": {"gyro_noise_density": 0.001, "time_offset_s": 0.0},
        },
        "settings": [{"name": "seen", "perturb": [*DEVICE["perturb"], {"pixelate": {"severity": 1}}]}],
    }
    said["camera"]["distortion"] = {"k1": 0.1}
    (tmp_path / "said.yaml").write_text(yaml.safe_dump(said))
    one, other = make_plan(taken), make_plan(read_preset(tmp_path / "said.yaml"))
    assert one.settings == other.settings
    assert one.cameras == other.cameras
    assert taken.spec.camera == other.preset.spec.camera
    assert taken.spec.rig == other.preset.spec.rig
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
        ({"imu": None}, ("measured.yaml", "imu", "is missing", "rig.imu.device", "--device")),
        ({"imu": {"gyro_noise": 1}}, ("measured.yaml", "imu.gyro_noise", "gyro_noise_density")),
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
    words += ["--html", str(tmp_path / "page.html")]
    assert command.main(words) == 0
    assert "severity   axial_noise" in capsys.readouterr().out
    shown = (tmp_path / "page.html").read_text()
    for told in (
        "A depth_noise_m_at",
        "B depth_noise_m_at",
        "B depth_correlation_1_px",
        "B gyro_spectrum_at",
        "axial_noise:",
    ):
        assert f"<title>{told}" in shown
    assert shown.count("crispEdges") == 2  # maps of holes
    only_depth = {"camera": {"device": "measured.yaml"}, "settings": [{"name": "clean"}]}
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump(PRESET | only_depth))
    assert make_plan(read_preset(tmp_path / "preset.yaml")).cameras["room"].width_px == 240
    (twin,) = (setting for setting in make_plan(read_preset(preset)).settings if setting.name == "twin")
    # A Kinect's disparity in eighths of a pixel; noise of three channels, of which EuRoC's grey is the mean (BT.601).
    steps = {step.perturbation.name: step.given for step in twin.steps}
    assert "structured_light" in steps
    assert steps["gaussian_noise"]["std"] == pytest.approx(0.02 * np.linalg.norm((0.299, 0.587, 0.114)), rel=0.1)
    before = device.read_bytes()
    assert command.main(words) == 1
    assert "is there already" in capsys.readouterr().err
    assert device.read_bytes() == before
