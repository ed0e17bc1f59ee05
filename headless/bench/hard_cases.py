# SPDX-License-Identifier: GPL-3.0-or-later
"""Cases in which rendering and poses lose digits, each a table of error against difficulty.

    python headless/bench/hard_cases.py         prints one line `@[...]` of tables

The truth is a formula in float64. Depth errors are relative to the depth, off the edges of surfaces.
"""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "tests/support")]

from analytic import CAMERAS, box_depth, box_mesh, look_at, plane_depth, quads_mesh, rays
from noisy_world.core import trajectory
from noisy_world.core.curve import RotationSpline
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.geometry import (
    Intrinsics,
    nearest_rotation,
    rotation_error,
    rotation_from_euler_deg,
    rotation_from_quat_wxyz,
)
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.images.pixels import quantise_depth, rgb_bytes
from noisy_world.render.mesh_session import Session
from noisy_world.render.source import RenderOptions
from noisy_world.scenes.polygon_mesh import Mesh

CAMERA = CAMERAS["fx above fy"]
OPTIONS = RenderOptions(near_m=0.01, far_m=1000.0, samples=1, seed=0)
REPLICA_SCALE, TUM_SCALE = 6553.5, 5000.0  # steps per metre
# The room that several cases render, and a view into it; chosen so that no face is parallel to the image.
LOW, HIGH = np.array([-1.5, -2.0, -1.0]), np.array([3.5, 2.5, 1.5])
EYE = look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2])
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Table:
    """A case: its title, its columns, its rows (texts and numbers) and a sentence on what they show."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float, ...], ...]
    note: str


def main() -> None:
    """Compute all cases and print them."""
    cases: list[Callable[[], Table]] = [
        far_from_the_origin,
        grazing_angles,
        triangle_sizes,
        near_and_far,
        thin_structures,
        coincident_faces,
        inside_a_wall,
        quantisation,
        composed_rotations,
        half_turns,
    ]
    print("@" + json.dumps([asdict(case()) for case in cases]), flush=True)


@dataclass(frozen=True)
class Image:
    """A rendered frame: colour (H, W, 3) and planar depth (H, W), metres."""

    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]


def render(mesh: Mesh, c2w: np.ndarray, options: RenderOptions = OPTIONS, camera: Intrinsics = CAMERA) -> Image:
    """Render one frame."""
    paths = SensorPaths(evenly_stamped(np.asarray(c2w)[None]))
    with Session(mesh, "case", paths, camera, options) as session:
        frame = session.frame(paths.request(0))
    assert frame.rgb is not None
    assert frame.depth_m is not None
    return Image(frame.rgb, frame.depth_m)


def worst(depth_m: np.ndarray, true_m: np.ndarray, where: np.ndarray) -> float:
    """Return the largest relative error; 1 where a surface was missed."""
    return float(np.abs(depth_m[where] / true_m[where] - 1).max())


@contextlib.contextmanager
def no_recentring() -> Iterator[None]:
    """Render at the world's own coordinates, as most tools do."""
    kept = trajectory.RECENTRE_BEYOND_M
    trajectory.RECENTRE_BEYOND_M = float("inf")
    try:
        yield
    finally:
        trajectory.RECENTRE_BEYOND_M = kept


def far_from_the_origin() -> Table:
    """A room moved away from the world's origin; float32 is spaced 8 mm apart at 1e5 m."""
    rows = []
    for distance_m in (1.0, 10.0, 100.0, 1e3, 1e4, 1e5):
        shift_m = distance_m * np.array([0.6, -0.64, 0.48])
        eye = EYE.copy()
        eye[:3, 3] += shift_m
        mesh = box_mesh(LOW + shift_m, HIGH + shift_m)
        true_m, sure = box_depth(CAMERA, eye, LOW + shift_m, HIGH + shift_m)
        with no_recentring():
            plain = worst(render(mesh, eye).depth_m, true_m, sure)
        rows.append((distance_m, worst(render(mesh, eye).depth_m, true_m, sure), plain))
    return Table(
        "Distance from the origin",
        ("distance, m", "error, recentred", "error, at the world's coordinates"),
        tuple(rows),
        "Scenes farther than 16 m away are rendered around their path, so depth stays what it is at the origin.",
    )


def grazing_angles() -> Table:
    """A floor seen at ever smaller angles: a ray's own rounding moves the hit by more and more."""
    eye = look_at([0.0, 0.0, 1.5], [1.0, 0.0, 1.5 - np.tan(np.radians(0.15))])
    # Strips that grow with the distance, so that the angle decides the error and not the size of a triangle.
    x_m = np.geomspace(0.5, 5e3, 80)
    strips = [[[a, -a, 0.0], [b, -b, 0.0], [b, b, 0.0], [a, a, 0.0]] for a, b in pairwise(x_m)]
    floor = quads_mesh(strips)
    camera = Intrinsics(640, 2001, 3000.0, 3000.0, 319.5, 1000.0)
    direction = rays(camera, eye)
    angle_deg = np.degrees(np.arcsin(-direction[..., 2] / np.linalg.norm(direction, axis=-1)))
    true_m = plane_depth(camera, eye, np.zeros(3), UP)
    depth_m = render(floor, eye, replace(OPTIONS, far_m=1e5), camera).depth_m
    rows = []
    for limit_deg in (10.0, 3.0, 1.0, 0.3, 0.1):
        ring = (angle_deg > 0.9 * limit_deg) & (angle_deg < 1.1 * limit_deg) & (true_m < 4e3)
        error = np.abs(depth_m[ring] / true_m[ring] - 1)
        # One pixel down changes the depth by about depth / (f sin(angle)), which is what errors are measured in.
        pixel = 1 / (camera.fy_px * np.sin(np.radians(limit_deg)))
        rows.append((limit_deg, float(np.median(error)), float(error.max()), float(error.max() / pixel)))
    return Table(
        "Grazing angle",
        ("angle to the surface, degrees", "median error", "largest error", "largest error, pixels of ray direction"),
        tuple(rows),
        "The error grows as 1 / sin(angle), because a ray's direction is float32; as a direction it stays below a "
        "thousandth of a pixel.",
    )


# How the wall of 8 m is cut: what the triangles are called, columns and lines.
CUTS = (
    ("4 m, two triangles", 1, 1),
    ("20 mm", 400, 400),
    ("4 mm", 2000, 2000),
    ("slivers 8 m x 2 mm, 1 : 4,000", 1, 4000),
    ("slivers 8 m x 0.02 mm, 1 : 400,000", 1, 400_000),
)


def triangle_sizes(cuts: Sequence[tuple[str, int, int]] = CUTS) -> Table:
    """One wall cut into triangles of very different sizes and shapes, and a floor of 10 km in two."""
    rows: list[tuple[str | float, ...]] = []
    eye = look_at([0.0, 0.0, 0.0], [1.0, 0.2, -0.1])
    true_m = plane_depth(CAMERA, eye, np.array([2.0, 0, 0]), np.array([1.0, 0, 0]))
    for label, columns, lines in cuts:
        mesh = grid_mesh(2.0, 4.0, columns, lines)
        depth_m = render(mesh, eye).depth_m
        inside = np.abs(rays(CAMERA, eye)[..., 1:] / rays(CAMERA, eye)[..., :1] * 2.0).max(-1) < 3.9
        missed = float(np.mean(depth_m[inside] == 0))
        rows.append((label, worst(depth_m, true_m, inside & (depth_m > 0)), missed))
    eye = look_at([3.0, -2.0, 1.5], [4.0, -1.0, 1.1])
    floor = quads_mesh([[[x, y, 0.0] for x, y in np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 5e3]])
    true_m = plane_depth(CAMERA, eye, np.zeros(3), UP)
    near = np.isfinite(true_m) & (true_m < 20)
    depth_m = render(floor, eye).depth_m
    rows.append(
        ("floor of 10 km in two, seen to 20 m", worst(depth_m, true_m, near), float(np.mean(depth_m[near] == 0)))
    )
    return Table(
        "Triangle size",
        ("triangles", "largest error", "share of rays that slip through"),
        tuple(rows),
        "No ray slips through. What costs digits is a triangle much larger than its distance, or much longer than "
        "wide: intersection in float32 is good to 1e-7 of its size. Cut a ground plane of kilometres into pieces.",
    )


def grid_mesh(x_m: float, half_m: float, columns: int, lines: int) -> Mesh:
    """A wall at x, cut into columns x lines quads."""
    y, z = np.meshgrid(np.linspace(-half_m, half_m, columns + 1), np.linspace(-half_m, half_m, lines + 1))
    vertices = np.stack([np.full(y.shape, x_m), y, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices), dtype=np.int32).reshape(y.shape)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    return Mesh(vertices, None, quads.ravel(), np.arange(0, quads.size, 4, dtype=np.int32))


def near_and_far() -> Table:
    """A wall square to the camera at the ends of several ranges: a z-buffer divides its digits over the range."""
    rows = []
    for near_m, far_m in ((1e-3, 1e3), (1e-2, 1e3), (1e-1, 1e2), (1.0, 1e5)):
        for distance_m in (1.05 * near_m, np.sqrt(near_m * far_m), 0.95 * far_m):
            row: list[str | float] = [near_m, far_m, float(distance_m)]
            for engine in ("cycles", "eevee", "workbench"):
                options = replace(OPTIONS, near_m=near_m, far_m=far_m, engine=engine)
                eye = look_at([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
                size_m = 4 * distance_m
                corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size_m
                wall = quads_mesh([[[distance_m, y, z] for y, z in corners]])
                camera = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
                true_m = plane_depth(camera, eye, np.array([distance_m, 0, 0]), np.array([1.0, 0, 0]))
                row.append(worst(render(wall, eye, options, camera).depth_m, true_m, np.isfinite(true_m)))
            rows.append(tuple(row))
    return Table(
        "Near and far clipping",
        ("near, m", "far, m", "wall at, m", "cycles", "eevee", "workbench"),
        tuple(rows),
        "An error of 1 is a wall that was not seen. Cycles does not mind the range. EEVEE and Workbench have a "
        "z-buffer: give them the largest near_m that the scene allows.",
    )


def thin_structures(samples: Sequence[int] = (1, 16, 64)) -> Table:
    """Upright rods of a width below a pixel against void: how much of them is seen. The first of samples is 1."""
    rng = np.random.default_rng(0)
    camera = Intrinsics(640, 240, 500.0, 500.0, 319.5, 119.5)
    eye = look_at([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    rows = []
    for width_px in (2.0, 1.0, 0.5, 0.25, 0.1):
        # Rods 2 m away, about 16 pixels apart, at random positions within their pixels.
        centres = 2.0 * (np.arange(-18, 19) * 16 + rng.uniform(-0.5, 0.5, 37)) / camera.fx_px
        half_m = width_px / camera.fx_px
        rods = quads_mesh(
            [
                [[2.0, y - half_m, -1], [2.0, y + half_m, -1], [2.0, y + half_m, 1], [2.0, y - half_m, 1]]
                for y in centres
            ],
            [[255, 255, 255]] * len(centres),
        )
        row: list[str | float] = [width_px, width_px * len(centres) / camera.width_px]
        for count in samples:
            frame = render(rods, eye, replace(OPTIONS, samples=count), camera)
            encoded = np.clip(frame.rgb[..., 0].astype(np.float64), 0, 1)
            linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
            row.append(float((encoded > 0.5).mean() if count == 1 else linear.mean()))
            if count == 1:
                row.append(float((frame.depth_m > 0).mean()))
        rows.append(tuple(row))
    return Table(
        "Thin structures",
        (
            "rod, px",
            "true share of the image",
            "share of colour, 1 sample",
            "share of depth",
            *(f"share of light, {count} samples" for count in samples[1:]),
        ),
        tuple(rows),
        "One ray a pixel sees a rod or misses it, right on average; depth always does, for it must not be averaged. "
        "More samples give colour its true share of light in every pixel.",
    )


def coincident_faces() -> Table:
    """Two walls of different colours in the same plane: which one is seen, and whether it is the same every time."""
    eye = look_at([0.0, 0.0, 0.0], [1.0, 0.3, -0.2])
    rows = []
    for gap_m in (0.0, 1e-7, 1e-6, 1e-5, 1e-4):
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 9.0
        walls = [[[2.0 + offset, y, z] for y, z in corners] for offset in (0.0, gap_m)]
        mesh = quads_mesh(walls, [[200, 30, 30], [30, 30, 200]])
        first, second = (render(mesh, eye) for _ in range(2))
        true_m = plane_depth(CAMERA, eye, np.array([2.0, 0, 0]), np.array([1.0, 0, 0]))
        front = float((rgb_bytes(first.rgb)[..., 0] == 200).mean())
        same = bool((first.rgb == second.rgb).all() and (first.depth_m == second.depth_m).all())
        rows.append((gap_m, front, worst(first.depth_m, true_m, true_m > 0), "yes" if same else "no"))
    return Table(
        "Coincident faces",
        ("gap, m", "share that shows the front wall", "largest error of depth", "same twice"),
        tuple(rows),
        "Closer than float32 tells them apart, either wall may show, the same one in every run; depth is right anyway.",
    )


def inside_a_wall() -> Table:
    """A camera inside a solid wall, and exactly on a face: what is in front of it is seen, from behind if need be."""
    low, high = np.array([0.0, -3.0, -3.0]), np.array([0.2, 3.0, 3.0])
    rows = []
    for label, x_m in (
        ("in the middle of 0.2 m", 0.1),
        ("2 cm from the face in front", 0.18),
        ("nearer to it than near_m", 0.195),
        ("exactly on the face behind", 0.0),
    ):
        eye = look_at([x_m, 0.1, 0.2], [x_m + 1.0, 0.3, 0.1])
        true_m, sure = box_depth(CAMERA, eye, low, high)
        depth_m = render(box_mesh(low, high), eye).depth_m
        seen = sure & (true_m > OPTIONS.near_m)
        hidden = float(np.mean(depth_m[true_m < 0.99 * OPTIONS.near_m] == 0)) if (true_m < OPTIONS.near_m).any() else ""
        rows.append((label, worst(depth_m, true_m, seen) if seen.any() else "nothing in sight", hidden))
    return Table(
        "Camera inside a wall",
        ("camera", "largest error", "share of what is nearer than near_m that is void"),
        tuple(rows),
        "Faces have no sides, so a wall is seen from inside too; at 2 cm float32 resolves 1e-6 m at best.",
    )


def quantisation() -> Table:
    """Depth in 16 bits: half a step, everywhere from 0.1 to 10 m."""
    depth_m = np.geomspace(0.1, 10.0, 1_000_000).astype(np.float32)
    rows = []
    for name, scale in (("Replica, 6553.5 a metre", REPLICA_SCALE), ("TUM, 5000 a metre", TUM_SCALE)):
        fits = depth_m.astype(np.float64) * scale < 65535
        error_m = np.abs(quantise_depth(depth_m, scale)[fits] / scale - depth_m[fits].astype(np.float64))
        near, far = error_m[:1000].max() / 0.1, error_m[-1000:].max() / 10
        rows.append((name, 0.5 / scale, float(error_m.max()), float(near), float(far), 65535 / scale))
    return Table(
        "16-bit depth from 0.1 to 10 m",
        ("layout", "half a step, m", "largest error, m", "relative at 0.1 m", "relative at 10 m", "largest depth, m"),
        tuple(rows),
        "Nothing beyond rounding. Near the camera the files, not the renderer, limit the depth.",
    )


def composed_rotations() -> Table:
    """A turn made in 1e5 steps, against the turn itself."""
    count = 100_000
    axis = np.array([1.0, 2.0, -2.0]) / 3
    total_rad = 1.0
    half = total_rad / count / 2
    step = rotation_from_quat_wxyz([np.cos(half), *(np.sin(half) * axis)])
    true = rotation_from_quat_wxyz([np.cos(total_rad / 2), *(np.sin(total_rad / 2) * axis)])
    rows = []
    for label, dtype, every in (
        ("float64", np.float64, 0),
        ("float64, made a rotation again every 100", np.float64, 100),
        ("float32, as Blender's own matrices are", np.float32, 0),
    ):
        turned, small = np.eye(3, dtype=dtype), step.astype(dtype)
        for k in range(count):
            turned = turned @ small
            if every and k % every == every - 1:
                turned = nearest_rotation(turned)
        error = float(np.abs(turned.astype(np.float64) - true).max())
        rows.append((label, error, float(rotation_error(turned)), float(np.linalg.det(turned.astype(np.float64)) - 1)))
    return Table(
        "100,000 composed rotations",
        ("arithmetic", "largest entry's error", "largest entry of R'R - I", "determinant - 1"),
        tuple(rows),
        "Poses stay float64 until they are keyed.",
    )


def half_turns() -> Table:
    """Interpolation between orientations nearly and exactly opposite, against the turn at even speed."""
    start = rotation_from_euler_deg(20.0, -35.0, 50.0)
    axis = np.array([2.0, -1.0, 2.0]) / 3
    u = np.linspace(0.0, 1.0, 1001)
    rows = []
    for angle_deg in (1e-7, 1.0, 90.0, 179.999999, 180.0, 180.000001):
        half = np.radians(angle_deg) / 2
        end = start @ rotation_from_quat_wxyz([np.cos(half), *(np.sin(half) * axis)])
        turned = RotationSpline(u[[0, -1]], np.stack([start, end])).at(u)
        errors = []
        for sign in (1.0, -1.0):  # at a half turn both arcs are equally short
            way = np.radians(angle_deg if sign > 0 else angle_deg - 360.0) * u / 2
            way_quats = np.concatenate([np.cos(way)[:, None], np.sin(way)[:, None] * axis], axis=-1)
            errors.append(float(np.abs(turned - start @ rotation_from_quat_wxyz(way_quats)).max()))
        rows.append((f"{angle_deg:.9g}", min(errors), float(rotation_error(turned).max())))
    return Table(
        "Interpolation across half turns",
        ("turn, degrees", "largest entry's error on the shorter way", "largest entry of R'R - I"),
        tuple(rows),
        "Even speed and the shorter way at every angle; at exactly 180 degrees one of the two.",
    )


if __name__ == "__main__":
    main()
