# SPDX-License-Identifier: GPL-3.0-or-later
"""`scan`: spin a lidar along the paths of a preset's meshes, and write its point clouds."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, get_args, get_type_hints

from .arguments import add_set_option, number, settled
from .command import Command
from .entry import Entry
from .parser import Parser
from .part import add_part_options, planned
from .places import out_path, path

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..core.datasets.scan_files import PointCloud
    from ..core.planning.plan import Plan, Render
    from ..core.trajectories.trajectory import Trajectory
    from ..perturbations.lidar import Lidar

LARGEST_HZ = 100.0


def _scan_options(parser: Parser) -> None:
    parser.add_argument("preset", metavar="PRESET", type=path, help="the preset; its perturbations do not matter")
    parser.add_argument("out", metavar="OUT", type=out_path, help="the folder to write, which is not there yet")
    parser.add_argument("--device", metavar="NAME", default="velodyne_vlp16", help="the lidar (default: %(default)s)")
    parser.add_argument(
        "--rate_hz",
        metavar="HZ",
        default=10.0,
        type=lambda text: number(text, f"turns a second up to {LARGEST_HZ:g}", lambda value: 0 < value <= LARGEST_HZ),
        help="turns a second (default: 10)",
    )
    parser.add_argument(
        "--noise",
        metavar="TIMES",
        default=1.0,
        type=lambda text: number(text, "0 or more", lambda value: 0 <= value <= 100.0),
        help="random errors, times the device's (default: 1)",
    )
    parser.add_argument(
        "--instant", action="store_true", help="all points of a turn are seen from its middle: motion distorts nothing"
    )
    add_set_option(parser)
    add_part_options(parser, ("scenes",))
    parser.set_defaults(settings=[], frames=None)


def _scan(options: argparse.Namespace, _: Entry) -> int:
    """Write the scans beside their place, and move them there when they are whole."""
    from ..core.datasets.storage import made_beside
    from ..core.errors import NoisyWorldError, StorageError
    from ..core.near import did_you_mean
    from ..perturbations.lidar import Lidar

    devices = get_args(get_type_hints(Lidar)["device"])
    if options.device not in devices:
        near = did_you_mean(options.device, devices)
        raise NoisyWorldError(f"unknown lidar {options.device!r}", remedy=near or f"there are {', '.join(devices)}")
    if options.out.exists():
        raise StorageError("is there already", file=options.out, remedy="choose another folder, or remove it")
    plan = planned(options)
    for scene in plan.scenes:
        if scene.source.mesh is None or scene.source.capabilities.own is not None:
            raise scene.error("is no mesh, and a lidar needs one for its rays", "name a mesh, or another --scenes")
    renders = {render.scene.name: render for render in reversed(plan.renders)}
    with made_beside(options.out) as made:
        counts = [_write_scene(plan, renders[scene.name], made / scene.name, options) for scene in plan.scenes]
    for scene, count in zip(plan.scenes, counts, strict=True):
        print(f"{scene.name}: {count} scans")
    print(f"wrote {options.out}")
    return 0


def _write_scene(plan: "Plan", render: "Render", folder: Path, options: argparse.Namespace) -> int:
    from ..core.datasets.scan_files import kitti_texts
    from ..core.planning.source_paths import source_paths
    from ..perturbations._depth_device import filled
    from ..perturbations.lidar import DEVICES, Lidar

    own = filled(Lidar(device=options.device, noise=options.noise), DEVICES)
    paths = source_paths(plan, render)
    along = paths.rgb if paths.depth is None else paths.depth
    turn_s = 1.0 / options.rate_hz
    stamps_s = _middles(along, turn_s, render)
    for kind in ("velodyne", "points"):
        (folder / kind).mkdir(parents=True)
    for index, cloud in enumerate(_clouds(plan, render, along, stamps_s, own, instant=options.instant, turn_s=turn_s)):
        (folder / f"velodyne/{index:06d}.bin").write_bytes(cloud.bin_bytes())
        (folder / f"points/{index:06d}.ply").write_bytes(cloud.ply_bytes())
    for name, text in kitti_texts(stamps_s, along.poses_at(stamps_s)).items():
        (folder / name).write_text(text, encoding="ascii", newline="\n")
    return len(stamps_s)


def _middles(along: "Trajectory", turn_s: float, render: "Render") -> "NDArray[np.float64]":
    """Return when each turn is half done, (N,); from the path's first stamp to its last."""
    import numpy as np

    span_s = float(along.stamps_s[-1] - along.stamps_s[0])
    count = int(np.floor(span_s / turn_s + 1e-9))
    if count < 1:
        problem = f"takes {span_s:g} s, less than one turn of {turn_s:g} s"
        raise render.scene.path_place.error(problem, "use a longer path, or a higher --rate_hz")
    return along.stamps_s[0] + (np.arange(count) + 0.5) * turn_s


def _clouds(
    plan: "Plan",
    render: "Render",
    along: "Trajectory",
    stamps_s: "NDArray[np.float64]",
    own: "Lidar",
    *,
    instant: bool,
    turn_s: float,
) -> "Iterator[PointCloud]":
    """Yield the point cloud of each turn; its random numbers are its own, by the preset's seed, scene and number."""
    import numpy as np

    from ..core.datasets.scan_files import PointCloud
    from ..core.planning.exposed import render_options
    from ..core.streams import stream
    from ..perturbations.lidar import returned
    from ..rays.spinning import Spin, SpinningCaster

    elevations_deg = np.linspace(-own.below_deg, own.above_deg, max(own.rows, 1))
    spin = Spin(elevations_deg, max(round(360.0 / own.azimuth_step_deg), 1), turn_s)
    assert render.scene.source.mesh is not None, "just checked"
    mesh = render.scene.source.mesh()
    rays = spin.columns * max(own.rows, 1) * len(stamps_s)
    with SpinningCaster(mesh, along, render_options(plan, render), rays) as caster:
        for index, stamp_s in enumerate(stamps_s):
            later_s = np.zeros(spin.columns) if instant else spin.parts * turn_s
            echoes = caster.cast(spin, along.poses_at(stamp_s + later_s))
            generator = stream(plan.preset.spec.seed, render.scene.name, "scan", own.device, frame=index)
            range_m = returned(echoes.range_m, echoes.cosine, own, generator)
            column, ring = np.nonzero(range_m.T)
            yield PointCloud(
                spin.beams[ring, column] * range_m[ring, column, None],
                (echoes.luminance * echoes.cosine)[ring, column],
                later_s[column],
                ring,
            )


SCAN = Command(
    name="scan",
    group="prepare and convert",
    help="spin a lidar along the paths of meshes: point clouds with times",
    description="Spin a lidar along the path of each of a preset's meshes, at the place of the rig's depth sensor "
    "or of the camera, and write a point cloud for each turn as KITTI lays them out: SCENE/velodyne/*.bin, "
    "times.txt, poses.txt, calib.txt; and SCENE/points/*.ply with the time and the row of each point.",
    options=_scan_options,
    settle=settled,
    run=_scan,
    stopped="nothing was written",
)
