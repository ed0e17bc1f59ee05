# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences on disk as others write them."""

import cv2
import numpy as np

SENSOR_YAML = """# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.1,
         1.0, 0.0, 0.0, 0.2,
         0.0, 0.0, 1.0, 0.3,
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [8, 6]
camera_model: pinhole
intrinsics: [458.654, 457.296, 3.5, 2.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
"""
STAMPS_NS = (1403636579760000000, 1403636579810000000)
POSES = ("1.0,2.0,3.0,1.0,0.0,0.0,0.0", "4.0,5.0,6.0,0.5,0.5,-0.5,0.5")
STATE_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)


def write_euroc(folder, *, colour=False, columns=8, line_end="\n", depth_late_ns=0):
    """Write two frames of 8 x 6 pixels as EuRoC has them: grey 100 and 110, or BGR (10, 20, 30); depth 2.5 m."""
    mav = folder / "mav0"
    for place in ("cam0/data", "depth0/data", "state_groundtruth_estimate0"):
        (mav / place).mkdir(parents=True)
    cam, depth = ["#timestamp [ns],filename"], ["#timestamp [ns], filename"]
    for k, stamp_ns in enumerate(STAMPS_NS):
        pixels = np.full((6, 8, 3), (10, 20, 30), np.uint8) if colour else np.full((6, 8), 100 + 10 * k, np.uint8)
        assert cv2.imwrite(str(mav / f"cam0/data/{stamp_ns}.png"), pixels)
        assert cv2.imwrite(str(mav / f"depth0/data/{stamp_ns + depth_late_ns}.png"), np.full((6, 8), 5000, np.uint16))
        cam.append(f"{stamp_ns},{stamp_ns}.png")
        depth.append(f"{stamp_ns + depth_late_ns}, {stamp_ns + depth_late_ns}.png")
    rest = ",0.0" * (columns - 8)
    state = [STATE_HEADER, *(f"{t},{row}{rest}" for t, row in zip(STAMPS_NS, POSES, strict=True))]
    for name, rows in (("cam0", cam), ("depth0", depth), ("state_groundtruth_estimate0", state)):
        (mav / name / "data.csv").write_bytes("".join(row + line_end for row in rows).encode())
    (mav / "cam0/sensor.yaml").write_bytes(SENSOR_YAML.replace("\n", line_end).encode())
    (mav / "depth0/sensor.yaml").write_bytes(
        (SENSOR_YAML + "depth_scale_per_m: 2000.0\n").replace("\n", line_end).encode()
    )


# As VSLAM-LAB writes it for rgbdtum's freiburg3, with other numbers: Datasets/DatasetVSLAMLAB_calibration.py.
CALIBRATION_YAML = """%YAML 1.2
---
cameras:
  - {cam_name: rgb_0,
     cam_type: rgb+depth,
     depth_name: depth_0,
     cam_model: pinhole,
     focal_length: [7.5, 7.25],
     principal_point: [3.5, 2.5],
     image_dimension: [8, 6],
     fps: 30.0,
     depth_factor: 2000.0,
     T_BS: [1.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 1.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 1.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 0.0000000000000, 1.0000000000000] # Sensor extrinsics wrt. the body-frame.
    }

"""  # noqa: E501


def write_vslamlab(folder, *, depth_late_ns=0):
    """Write two frames of 8 x 6 pixels as VSLAM-LAB has them: colour BGR (10, 20, 30), depth 2.5 m, named by stamps."""
    rows = ["ts_rgb_0 (ns),path_rgb_0,ts_depth_0 (ns),path_depth_0"]
    truth = ["ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw"]
    for name in ("rgb_0", "depth_0"):
        (folder / name).mkdir(parents=True)
    for k, stamp_ns in enumerate(STAMPS_NS):
        late_ns = stamp_ns + depth_late_ns
        assert cv2.imwrite(str(folder / f"rgb_0/{stamp_ns}.png"), np.full((6, 8, 3), (10, 20, 30), np.uint8))
        assert cv2.imwrite(str(folder / f"depth_0/{late_ns}.png"), np.full((6, 8), 5000, np.uint16))
        rows.append(f"{stamp_ns},rgb_0/{stamp_ns}.png,{late_ns},depth_0/{late_ns}.png")
        truth.append(f"{stamp_ns},{k}.0,2.0,3.0,0.5,-0.5,0.5,0.5")
    for name, lines in (("rgb.csv", rows), ("groundtruth.csv", truth)):
        (folder / name).write_text("".join(line + "\n" for line in lines))
    (folder / "calibration.yaml").write_text(CALIBRATION_YAML)
