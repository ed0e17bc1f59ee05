# SPDX-License-Identifier: GPL-3.0-or-later
"""`simulate`: let a robot's body follow a scene's path over its floor, by physics, and write its camera's path."""

import argparse

from .arguments import add_set_option, number, settled
from .command import Command
from .entry import Entry
from .parser import Parser
from .part import add_part_options, planned
from .places import out_path, path
from .video_command import check_free


def _simulate_options(parser: Parser) -> None:
    parser.add_argument("preset", metavar="PRESET", type=path, help="the preset; one of its scenes, by --scenes")
    written = "the file to write, in TUM's format; one that is there is replaced"
    parser.add_argument("out", metavar="OUT.txt", type=out_path, help=written)
    parser.add_argument(
        "--roughness",
        metavar="M",
        default=0.0,
        type=lambda text: number(text, "metres from 0 to 0.1", lambda value: 0.0 <= value <= 0.1),
        help="the standard deviation of the floor's height, in metres (default: 0)",
    )
    add_set_option(parser)
    add_part_options(parser, ("scenes",))
    parser.set_defaults(settings=[], frames=None)


def _simulate(options: argparse.Namespace, _: Entry) -> int:
    """Simulate, and write the file."""
    from ..core.datasets.storage import made_beside
    from ..core.errors import NoisyWorldError
    from ..core.extras import need
    from ..core.trajectories.bodies import BODIES
    from ..core.trajectories.stamped_poses import tum_text
    from ..simulation.controllers import MOST_M_S
    from ..simulation.run import simulate
    from ..sources.mesh_source import MeshSource

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
