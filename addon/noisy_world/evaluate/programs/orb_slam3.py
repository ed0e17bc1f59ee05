# SPDX-License-Identifier: GPL-3.0-or-later
"""ORB-SLAM3 on a sequence, by orbslam3-python; a program of its own, in an environment of systems.

    .venv-slam/bin/python orb_slam3.py FRAMES OUT VOCABULARY --near-m M --pixel-noise-px PX --slope S
    .venv-slam/bin/python orb_slam3.py FRAMES OUT VOCABULARY --near-m M --bf-px-m BF [--misread]
    .venv-slam/bin/python orb_slam3.py FRAMES OUT VOCABULARY --mono
    .venv-slam/bin/python orb_slam3.py --versions VOCABULARY

Writes trajectory.txt (TUM, camera-to-world, the tracked frames), keyframes.txt and frames.csv. Poses are those at the
end, after loops are closed, as ORB-SLAM3's own SaveTrajectoryTUM has them. Before the next frame is shown, the threads
that build the map get as much of a processor's time as the camera's rate gives them, or as they need: so other programs
on the machine do not change what becomes of a sequence.
"""

import argparse
import hashlib
import json
import os
import sys
import threading
import time
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from frame_files import inverse, read_image, rigid, tum_text
from orb_settings import add_options, gap_of, settings_text

try:
    import orbslam3  # pyright: ignore[reportMissingImports] - of the other environment
except ImportError as error:  # of several lines, the last of which names nothing
    sys.exit(f"orbslam3 cannot be imported: {' '.join(str(error).split())}")

THREADS = Path("/proc/self/task")
BUSY = ("R", "D")  # states of a thread that has something to do
QUIET_S, QUIET_TIMES = 0.002, 3  # chosen: the map's threads look for work every 3 and every 5 ms
END_S = 20.0  # of a processor, for bundle adjustment over the whole map after the last frame
PATIENCE = 20.0  # chosen: how many times as long is waited for a processor that others use


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    if arguments[:1] == ["--versions"]:
        print(json.dumps(versions(Path(arguments[1]))))
        return 0
    parser = argparse.ArgumentParser(prog="orb_slam3.py", description="Run ORB-SLAM3 on a sequence.")
    parser.add_argument("frames", type=Path, help="the index of the frames")
    parser.add_argument("out", type=Path, help="the folder to write into")
    parser.add_argument("vocabulary", type=Path, help="a vocabulary in DBoW2's text format")
    add_options(parser)
    parser.add_argument(
        "--misread", action="store_true", help="depth as the paper's published code reads it: as a colour image"
    )
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    index = json.loads(options.frames.read_text(encoding="utf-8"))
    settings = options.out / "orb_slam3.yaml"
    settings.write_text(settings_text(index, options), encoding="utf-8")
    run(index, options.out, options.vocabulary, settings, mono=options.mono, misreading=options.misread)
    return 0


def versions(vocabulary: Path) -> dict[str, str]:
    """Return the versions of what runs, and which vocabulary it has."""
    digest = hashlib.sha256(vocabulary.read_bytes()).hexdigest()
    return {
        "orbslam3-python": version("orbslam3-python"),
        "opencv": cv2.__version__,
        "python": ".".join(map(str, sys.version_info[:3])),
        "vocabulary": f"{vocabulary.stem}, sha256 {digest[:16]}",
    }


def run(index: dict, out: Path, vocabulary: Path, settings: Path, *, mono: bool, misreading: bool) -> None:
    """Show all frames to the system, then write what it estimated."""
    sensor = orbslam3.Sensor.MONOCULAR if mono else orbslam3.Sensor.RGBD
    system = orbslam3.System(str(vocabulary), str(settings), sensor)
    system.set_use_viewer(False)
    if not system.initialize():
        raise SystemExit("orb_slam3.py: ORB-SLAM3 does not start with these settings")
    frames, gap_s = index["frames"], gap_of(index)
    start_s = frames[0]["stamp_s"]
    rows: list[str] = []
    online: dict[int, np.ndarray] = {}  # w2c of the tracked frames, as they were found
    for frame in frames:
        colour = read_image(frame["colour"], cv2.IMREAD_COLOR)[..., ::-1].copy()
        stamp_s = frame["stamp_s"] - start_s
        others_s, begun_s = others_processor_s(), time.thread_time()
        if mono:
            system.process_image_mono(colour, stamp_s)
        else:
            steps = read_image(frame["depth"], cv2.IMREAD_UNCHANGED)
            steps = misread(steps) if misreading else steps
            system.process_image_rgbd(colour, (steps / index["depth_scale_per_m"]).astype(np.float32), stamp_s)
        tracking_s = time.thread_time() - begun_s
        settle(others_s, gap_s)
        state = state_name(str(system.get_tracking_state()))
        if state == "tracked":
            online[frame["index"]] = np.array(system.get_frame_pose(), dtype=np.float64)
        rows.append(
            f"{frame['index']},{frame['stamp_s']!r},{state},"
            f"{system.get_num_features()},{system.get_num_matched_features()},{tracking_s:.4f}\n"
        )
    settle(others_processor_s(), END_S)
    header = "index,stamp_s,state,features,matched,tracking_s\n"
    (out / "frames.csv").write_text(header + "".join(rows), encoding="utf-8")
    stamps_s = np.array([frame["stamp_s"] for frame in frames])
    final = {
        nearest(stamps_s, stamp_s + start_s): np.array(w2c, float) for stamp_s, w2c in system.get_trajectory_points()
    }
    poses = {k: inverse(w2c) for k, w2c in placed(online, final).items()}
    keyframes = {
        nearest(stamps_s, stamp_s + start_s): rigid(rotation, position)
        for stamp_s, rotation, position in system.get_keyframe_points()
    }
    (out / "trajectory.txt").write_text(tum_text(stamps_s, poses), encoding="utf-8")
    (out / "keyframes.txt").write_text(tum_text(stamps_s, keyframes), encoding="utf-8")


def misread(steps: np.ndarray) -> np.ndarray:
    """Return depth (H, W) uint16 as ORB-SLAM3 gets it where a program reads its file as a colour image.

    OpenCV keeps the upper 8 bits, three times beside each other; ORB-SLAM3 takes the row as if it had one channel, so
    that column u holds what column u // 3 should, 256 times too small (perturb_image.py, line 59, of the paper's code).
    """
    return (steps >> 8)[:, np.arange(steps.shape[1]) // 3]


def settle(begun_s: float, period_s: float) -> None:
    """Wait until the other threads of this process have had a time of a processor, or have nothing to do.

    begun_s: what they had when the period began. Where the system does not tell, do not wait.
    """
    if not THREADS.is_dir():
        return
    until = time.monotonic() + PATIENCE * period_s
    quiet = 0
    while quiet < QUIET_TIMES and others_processor_s() < begun_s + period_s and time.monotonic() < until:
        time.sleep(QUIET_S)
        quiet = 0 if others_are_busy() else quiet + 1


def others_processor_s() -> float:
    """Return the seconds of a processor that the other threads of this process have had."""
    return time.process_time() - time.thread_time()


def others_are_busy() -> bool:
    """Tell whether another thread of this process is running, or would if it had a processor."""
    own = str(threading.get_native_id())
    for task in THREADS.iterdir():
        if task.name == own:
            continue
        try:
            status = (task / "stat").read_text()
        except OSError:  # it has ended
            continue
        if status.rpartition(")")[2].split()[0] in BUSY:
            return True
    return False


def state_name(state: str) -> str:
    """Return the name of a tracking state in frames.csv."""
    word = state.rpartition(".")[2]
    if word == "OK":
        return "tracked"
    return "lost" if word in ("LOST", "RECENTLY_LOST") else "not_initialised"


def placed(online: dict[int, np.ndarray], final: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Return the final w2c of each tracked frame.

    The binding leaves out frames whose keyframe was removed from the map: they are placed by their motion, as it was
    found when they were tracked, from the frame before that has a final pose.
    """
    poses: dict[int, np.ndarray] = {}
    last = None
    for index in sorted(online):
        if index in final:
            poses[index] = final[index]
            last = index
        elif last is not None:
            poses[index] = online[index] @ inverse(online[last]) @ final[last]
    return poses


def nearest(stamps_s: np.ndarray, stamp_s: float) -> int:
    """Return the index of the frame whose stamp is nearest."""
    return int(np.argmin(np.abs(stamps_s - stamp_s)))


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    # ORB-SLAM3 may hang while it ends its threads; what it found is written.
    os._exit(status)
