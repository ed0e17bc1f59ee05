# SPDX-License-Identifier: GPL-3.0-or-later
"""`simulate`, `scan`, `bag`, `export`: paths by physics, lidar scans, bags of ROS, meshes as PLY."""

import argparse
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args, get_type_hints

from ..core.errors import InputError, NoisyWorldError, StorageError, did_you_mean
from ..core.packages import need
from ..core.progress import counted
from .arguments import Parser, add_part_options, add_set_option, number, out_path, path, planned, settled
from .command import Command
from .entry import Entry
from .viewing import check_free

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..core.trajectory import Trajectory
    from ..dataset.plan import Plan, Render
    from ..layouts.robot_files import PointCloud
    from ..perturbations.shipped.lidar import Lidar


def _simulate_options(parser: Parser) -> None:
    parser.option("preset PRESET", "the preset; one of its scenes, by --scenes", type=path)
    written = "the file to write, in TUM's format; one that is there is replaced"
    parser.option("out OUT.txt", written, type=out_path)
    parser.option(
        "--roughness M",
        "the standard deviation of the floor's height, in metres (default: 0)",
        default=0.0,
        type=lambda text: number(text, "metres from 0 to 0.1", lambda value: 0.0 <= value <= 0.1),
    )
    add_set_option(parser)
    add_part_options(parser, ("scenes",))
    parser.set_defaults(settings=[], frames=None)


def _simulate(options: argparse.Namespace, _: Entry) -> int:
    """Simulate, and write the file."""
    from ..core.atomic_files import made_beside
    from ..sources.rendered_mesh import MeshSource
    from ..trajectories.bodies import BODIES
    from ..trajectories.simulation import MOST_M_S, simulate
    from ..trajectories.stamped_poses import tum_text

    need(("mujoco",), "simulate")
    check_free(options.out, overwrite=True)
    plan = planned(options)
    if len(plan.scenes) != 1:
        named = ", ".join(scene.name for scene in plan.scenes)
        raise NoisyWorldError(
            f"{options.preset} has {len(plan.scenes)} scenes ({named})", remedy="name one by --scenes"
        )
    source = plan.scenes[0].source
    where = plan.scenes[0].place.at("trajectory").at("body")
    body = source.spec.body if isinstance(source, MeshSource) else None
    if not isinstance(source, MeshSource) or body is None or body.kind not in ("quadruped", "rover"):
        raise where.error("has to be a quadruped or a rover of a mesh to be simulated", "say body: rover")
    if body.motion != 1.0:
        problem = "multiplies the formulas' motion, and a body by physics moves by its own"
        raise where.at("motion").error(problem, "leave it out; --roughness shakes it more")
    route = source.trajectory()
    floor_m = float(route.c2w[:, 2, 3].mean()) - BODIES[body.kind].height_m
    try:
        way = simulate(route, body.kind, floor_m=floor_m, roughness_m=options.roughness, seed=source.path_seed)
    except NoisyWorldError as error:
        raise where.error(str(error)) from error
    source.check_room(way.path)
    said = f"{body.kind} of {plan.scenes[0].name}, roughness {options.roughness:g} m, seed {source.path_seed}"
    header = f"# {said}; simulated by MuJoCo {way.version}\n# t tx ty tz qx qy qz qw: camera-to-world, OpenCV axes\n"
    with made_beside(options.out) as made:
        made.write_bytes((header + tum_text(way.path)).encode())
    if way.held_back:
        print(
            f"the route is faster than the {MOST_M_S[body.kind]:g} m/s that a {body.kind} goes at, so it takes longer"
        )
    print(
        f"wrote {options.out}: {len(way.path)} poses, {way.path.stamps_s[-1]:.1f} s; use it as trajectory: "
        f"{{file: {options.out.name}, resample_hz: 30}}"
    )
    return 0


SIMULATE = Command(
    name="simulate",
    order=210,
    group="prepare and convert",
    help="let a robot's body follow a scene's path, by physics: a path file",
    description="Let a quadruped or a rover, the body of a scene's trajectory, follow that path over the floor by "
    "physics (MuJoCo), and write the path of its camera: a file that a preset's trajectory names, so that "
    "rendering needs no MuJoCo. The way is checked against the mesh.",
    options=_simulate_options,
    settle=settled,
    run=_simulate,
    stopped="nothing was written",
)


# --- `scan` ---


LARGEST_HZ = 100.0


def _scan_options(parser: Parser) -> None:
    parser.option("preset PRESET", "the preset; its perturbations do not matter", type=path)
    parser.option("out OUT", "the folder to write, which is not there yet", type=out_path)
    parser.option("--device NAME", "the lidar (default: %(default)s)", default="velodyne_vlp16")
    parser.add_argument(
        *("--rate-hz", "--rate_hz"),
        metavar="HZ",
        help="turns a second (default: 10)",
        default=10.0,
        type=lambda text: number(text, f"turns a second up to {LARGEST_HZ:g}", lambda value: 0 < value <= LARGEST_HZ),
    )
    parser.option(
        "--noise TIMES",
        "random errors, times the device's (default: 1)",
        default=1.0,
        type=lambda text: number(text, "0 or more", lambda value: 0 <= value <= 100.0),
    )
    parser.flag("--instant", "all points of a turn are seen from its middle: motion distorts nothing")
    add_set_option(parser)
    add_part_options(parser, ("scenes",))
    parser.set_defaults(settings=[], frames=None)


def _scan(options: argparse.Namespace, _: Entry) -> int:
    """Write the scans beside their place, and move them there when they are whole."""
    from ..core.atomic_files import made_beside
    from ..perturbations.shipped.lidar import Lidar

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
        print(f"{scene.name}: {counted(count, 'scan')}")
    print(f"wrote {options.out}")
    return 0


def _write_scene(plan: "Plan", render: "Render", folder: Path, options: argparse.Namespace) -> int:
    from ..dataset.rendering import source_paths
    from ..layouts.robot_files import kitti_texts
    from ..perturbations.shipped._depth_devices import filled
    from ..perturbations.shipped.lidar import DEVICES, Lidar

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
        raise render.scene.path_place.error(problem, "use a longer path, or a higher --rate-hz")
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

    from ..core.streams import stream
    from ..dataset.rendering import render_options
    from ..layouts.robot_files import PointCloud
    from ..perturbations.shipped.lidar import returned
    from ..render.ray_session import Spin, SpinningCaster

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
    order=220,
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


# --- `bag` ---


STORAGES = ("mcap", "sqlite3")


def _bag_options(parser: Parser) -> None:
    parser.option("sequence SEQUENCE", "the sequence's folder, of any layout", type=path)
    out = "the bag, not there yet: a file ending .bag is one of ROS 1, one ending .mcap or a folder one of ROS 2"
    parser.option("place OUT", out, type=out_path, nargs="?")
    parser.option("--out OUT", "the same", type=out_path)
    parser.option("--storage", "what is in a folder (default: mcap)", choices=STORAGES)
    parser.option(
        "--over BAG",
        "a bag, all of whose other messages are kept as they are: images of the sequence take the place of its own",
        type=path,
    )
    parser.option("--rgb TOPIC", "with --over: the topic of colour, where several fit")
    parser.option("--depth TOPIC", "with --over: the topic of depth, where several fit; none keeps what is there")
    parser.option(
        "--depth_scale_per_m STEPS",
        "with --over: steps a metre of its depth in whole numbers (default: 1000)",
        type=lambda text: number(text, "steps a metre above 0", lambda value: value > 0),
    )


def _settled_bag(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if (options.place is None) == (options.out is None):
        parser.error("name the bag to write, by --out")
    options.out = options.out or options.place
    if options.over is None:
        for name in ("rgb", "depth", "depth_scale_per_m"):
            if getattr(options, name) is not None:
                parser.error(f"--{name} goes with --over")
    elif options.storage is not None:
        parser.error("--storage goes without --over: a copy is what the bag is")
    return options


def _write_bag(options: argparse.Namespace, _: Entry) -> int:
    """Write the bag beside its place, and move it there when it is whole."""
    from ..core.atomic_files import made_beside

    need(("rosbags",), "ros")
    if os.path.lexists(options.out):
        raise StorageError("is there already", file=options.out, remedy="choose another, or remove it")
    with made_beside(options.out) as made:
        counts = _fill_bag(options, made)
    said = ", ".join(f"{count} {topic}" for topic, count in counts.items() if count)
    print(f"wrote {options.out}: {said}")
    return 0


def _fill_bag(options: argparse.Namespace, made: Path) -> Counter[str]:
    from ..layouts.bag_writing import Form, check_copy, write_over, write_sequence
    from ..layouts.described import BagTopics

    if options.over is not None:
        check_copy(options.over, options.out)
        topics = BagTopics(rgb=options.rgb, depth=options.depth)
        counts, notes = write_over(options.sequence, options.over, made, topics, options.depth_scale_per_m)
        for note in notes:
            print(note)
        return counts
    forms: dict[str, Form] = {".bag": "ros1", ".mcap": "mcap", ".db3": "sqlite3"}
    form, storage = forms.get(options.out.suffix), options.storage or STORAGES[0]
    if form is not None and options.storage is not None:
        raise InputError("--storage", f"is for a folder, and {options.out.name} is a file", remedy="leave it out")
    return write_sequence(options.sequence, made, form or storage)


BAG = Command(
    name="bag",
    order=230,
    group="prepare and convert",
    help="write a sequence as a bag of ROS, or over the images of one",
    description="Write a sequence as a bag of ROS 1 or ROS 2, without ROS: images, depth in metres, cameras, the IMU "
    "if there is one, and the true poses as transforms. With --over, write a copy of a bag with the sequence's images "
    "in place of its own.",
    options=_bag_options,
    settle=_settled_bag,
    run=_write_bag,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)


# `export`: write a mesh as PLY in Replica's layout: an embedded room, or any mesh file that Noisy World reads.
#
# Where faces have colours, each vertex is written once for each colour that meets there. Textures have no place in the
# layout: they are written beside the file and named in it as MeshLab does. Many readers cannot read quads and other
# polygons; --triangulate is for those.


ENDING = ".ply"


def _export_options(parser: Parser) -> None:
    # Without numpy the help is shown too, so a test holds the numbers of rooms.
    parser.option("mesh MESH", "a PLY, glTF, OBJ, USD, FBX or STL file, or embedded:room?seed=0 to 7", type=path)
    parser.option("out OUT.ply", "the file to write; one that is there is replaced", type=out_path)
    up = "the axis of the file that points up, where that is not what the file declares; y is turned to Z up"
    parser.option("--up", up, choices=("y", "z"))
    parser.flag("--triangulate", "cut every polygon into triangles")


def _export(options: argparse.Namespace, _: Entry) -> int:
    """Write the mesh, and print what was written."""
    from ..rooms import kept_room
    from ..scenes.ply import read_header
    from ..scenes.ply_writer import write_ply, write_textured_ply
    from ..scenes.polygon_mesh import is_embedded
    from ..sources.rendered_mesh import read_mesh

    if options.out.suffix.lower() != ENDING:
        problem = "its ending is not .ply, and PLY is what is written"
        raise InputError(options.out, problem, remedy=f"write {options.out.stem or 'mesh'}{ENDING}")
    name = str(options.mesh)
    if options.up is not None and is_embedded(name):
        raise InputError("--up", "goes with the file of a mesh", remedy="leave it out")
    mesh = kept_room(_one_room(name)) if is_embedded(name) else read_mesh(options.mesh, options.up)
    pictures: Sequence[Path] = ()
    if mesh.texture is None:
        write_ply(options.out, mesh, triangulate=options.triangulate)
    else:
        pictures = write_textured_ply(options.out, mesh, mesh.texture, triangulate=options.triangulate)
    for note in mesh.notes:
        print(note)
    if pictures:
        print(f"wrote {', '.join(map(str, pictures))}: its textures, which Replica's layout has not")
    vertices = read_header(options.out).elements["vertex"].rows
    faces = int((mesh.face_sizes - 2).sum()) if options.triangulate else len(mesh.face_starts)
    print(f"wrote {options.out}: {vertices} vertices, {faces} faces")
    return 0


def _one_room(mesh: str) -> int:
    from ..scenes.polygon_mesh import MEANT, room_seeds

    try:
        seeds = room_seeds(mesh)
    except ValueError as error:
        raise NoisyWorldError(f"{error}; {MEANT}") from error
    if len(seeds) > 1:
        raise NoisyWorldError(f"{mesh} is {len(seeds)} rooms, and a file holds one; name one of them")
    return seeds[0]


EXPORT = Command(
    name="export",
    order=240,
    group="prepare and convert",
    help="write a mesh as PLY in Replica's layout",
    description="Write a mesh as PLY in Replica's layout.",
    options=_export_options,
    run=_export,
    needs=("numpy", "cv2"),
)

COMMAND = SIMULATE, SCAN, BAG, EXPORT
