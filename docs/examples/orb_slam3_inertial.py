# SPDX-License-Identifier: GPL-3.0-or-later
"""Run ORB-SLAM3 with an IMU on a sequence of the layout `euroc`, and say how far its path is from the true one.

    pip install pyorbslam3==0.1.1 opencv-python-headless numpy
    python orb_slam3_inertial.py SEQUENCE rgbd|mono VOCABULARY OUT

SEQUENCE has `mav0` and `settings`, as `noisy-world generate` writes them with `rig.imu`; it knows nothing else of
Noisy World. VOCABULARY is in DBoW2's text format. OUT gets `trajectory.txt`, the IMU's poses as ORB-SLAM3 writes them.
Before the next frame is shown, the threads that build the map get as much of a processor's time as the camera's rate
gives them, or as they need. The path is moved onto the true one best (Horn, 1987), without scale; the scale is told.
"""

import argparse
import csv
import importlib
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

QUIET_S, QUIET_TIMES = 0.002, 3  # chosen: the map's threads look for work every 3 and every 5 ms
PATIENCE = 20.0  # chosen: how many times as long is waited for a processor that others use
END_S = 3.0  # of a processor, after the last frame
NS_PER_S = 1_000_000_000


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(description="Run ORB-SLAM3 with an IMU on a sequence of the layout euroc.")
    parser.add_argument("sequence", type=Path, help="a folder with mav0 and settings")
    parser.add_argument("mode", choices=("rgbd", "mono"), help="with depth or without")
    parser.add_argument("vocabulary", type=Path, help="in DBoW2's text format")
    parser.add_argument("out", type=Path, help="the folder to write into")
    parser.add_argument("--frames", type=int, help="how many, from the first on (default: all)")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "trajectory.txt"
    states, began_s = run(options.sequence, options.mode, options.vocabulary, path, options.frames)
    print(f"{states['OK']} of {states.total()} frames tracked; IMU initialised: {began_s or 'never'}")
    if states["OK"] < 3:
        return 1
    error_m, scale = absolute_error(options.sequence, path)
    print(f"ATE {1e3 * error_m:.1f} mm; the estimate's scale is {scale:.4f}")
    return 0


def run(sequence: Path, mode: str, vocabulary: Path, path: Path, count: int | None) -> tuple[Counter[str], str]:
    """Show frames to ORB-SLAM3 and write its path; return how many had which state, and when its IMU began."""
    pyorbslam3 = importlib.import_module("pyorbslam3")
    settings = sequence / "settings" / f"orb_slam3_{mode}_inertial.yaml"
    sensor = pyorbslam3.Sensor.IMU_RGBD if mode == "rgbd" else pyorbslam3.Sensor.IMU_MONOCULAR
    slam = pyorbslam3.Slam(str(vocabulary), str(settings), sensor)
    samples, frames = read_samples(sequence), read_frames(sequence)[:count]
    gap_s = (frames[1][0] - frames[0][0]) / NS_PER_S
    states: Counter[str] = Counter()
    began_s, before_ns = "", -1
    for stamp_ns, grey_file, depth_file in frames:
        felt = between(samples, before_ns, stamp_ns)
        grey, others_s = read_image(grey_file), others_processor_s()
        if mode == "rgbd":  # steps of depth: the settings tell how many a metre has
            steps = read_image(depth_file).astype(np.float32)
            found = slam.track_rgbd(grey, steps, stamp_ns / NS_PER_S, felt)
        else:
            found = slam.track_monocular(grey, stamp_ns / NS_PER_S, felt)
        settle(others_s, gap_s)
        states[found.state.name] += 1
        before_ns = stamp_ns
        if not began_s and slam.imu_initialized():
            began_s = f"{(stamp_ns - frames[0][0]) / NS_PER_S:g} s"
    settle(others_processor_s(), END_S)
    slam.save_trajectory_euroc(str(path))
    return states, began_s


def read_frames(sequence: Path) -> list[tuple[int, Path, Path]]:
    """Return each frame's stamp in nanoseconds, its image and its depth image."""
    tables = []
    for sensor in ("cam0", "depth0"):
        folder = sequence / "mav0" / sensor
        with (folder / "data.csv").open(newline="") as file:
            tables.append([(int(row[0]), folder / "data" / row[1]) for row in list(csv.reader(file))[1:]])
    return [(stamp_ns, grey, depth) for (stamp_ns, grey), (_, depth) in zip(*tables, strict=True)]


def read_samples(sequence: Path) -> NDArray[np.float64]:
    """Return samples (N, 7): time in seconds, angular velocity in rad/s, specific force in m/s^2."""
    samples = np.loadtxt(sequence / "mav0/imu0/data.csv", delimiter=",", skiprows=1)
    samples[:, 0] /= NS_PER_S
    return samples


def between(samples: NDArray[np.float64], before_ns: int, now_ns: int) -> NDArray[np.float64]:
    """Return the samples after one frame's stamp, up to the next one's."""
    stamps_ns = np.rint(samples[:, 0] * NS_PER_S)
    return samples[(stamps_ns > before_ns) & (stamps_ns <= now_ns)]


def read_image(path: Path) -> NDArray[np.generic]:
    """Return an image as it is stored. A file that is none ends the program with a line."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        sys.exit(f"{path}: is no image")
    return image


def others_processor_s() -> float:
    """Return the seconds of a processor that the other threads of this process have had."""
    return time.process_time() - time.thread_time()


def settle(begun_s: float, period_s: float) -> None:
    """Wait until the other threads have had a time of a processor since they had begun_s, or have nothing to do."""
    until, quiet = time.monotonic() + PATIENCE * period_s, 0
    while quiet < QUIET_TIMES and others_processor_s() < begun_s + period_s and time.monotonic() < until:
        time.sleep(QUIET_S)
        quiet = 0 if others_are_busy() else quiet + 1


def others_are_busy() -> bool:
    """Tell whether another thread of this process is running, or would if it had a processor."""
    own = str(threading.get_native_id())
    for task in Path("/proc/self/task").iterdir():
        try:
            status = (task / "stat").read_text()
        except OSError:  # it has ended
            continue
        if task.name != own and status.rpartition(")")[2].split()[0] in "RD":
            return True
    return False


def absolute_error(sequence: Path, path: Path) -> tuple[float, float]:
    """Return the root mean square error of the positions in metres, and the scale of the estimate, by Horn's method."""
    truth = np.loadtxt(sequence / "mav0/state_groundtruth_estimate0/data.csv", delimiter=",", skiprows=1)
    estimate = np.loadtxt(path, ndmin=2)
    nearest = np.argmin(np.abs(truth[:, :1] - estimate[:, 0]), axis=0)
    found, true = (points[:, 1:4] - points[:, 1:4].mean(axis=0) for points in (estimate, truth[nearest]))
    left, sizes, right = np.linalg.svd(true.T @ found)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    error_m = true - found @ (left * signs @ right).T
    return float(np.sqrt((error_m**2).sum(axis=1).mean())), float((found**2).sum() / (sizes * signs).sum())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
