# SPDX-License-Identifier: GPL-3.0-or-later
"""EEVEE and Workbench on software GL, and what is left out where it is not asked for."""

import json
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from analytic import box_mesh, look_at, plane_depth, plane_mesh, quads_mesh
from engines import gl_engines, need_gl
from refusals import refused

from noisy_world.render.engines import MARK, compositor_card, gl_version
from noisy_world.render.mesh_session import Session, renderer_versions
from noisy_world.core.errors import MissingDependencyError, NoisyWorldError, StorageError
from noisy_world.core.geometry import Intrinsics
from noisy_world.images.pixels import rgb_bytes
from noisy_world.render.source import RenderOptions
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped

CAMERA = Intrinsics(160, 120, 110.0, 90.0, 70.0, 66.5)
OPTIONS = RenderOptions(near_m=0.01, far_m=1000.0, samples=1, seed=0)
EYE = look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2])


def render(mesh, options, c2w=EYE, camera=CAMERA, count=1):
    need_gl(options.engine)
    poses = np.asarray(c2w)[None].repeat(count, 0)
    paths = SensorPaths(evenly_stamped(poses))
    with Session(mesh, "test", paths, camera, options) as session:
        return session.frame(paths.request(count - 1))


@gl_engines
def test_depth_and_flat_colours_of_a_slanted_board(engine):
    # 48 squares, each 20 pixels wide in the image, on a plane across the view.
    colours = np.random.default_rng(2).integers(0, 256, (48, 3))
    normal = EYE[:3, :3] @ np.array([0.5, 0.3, -0.8]) / np.sqrt(0.98)
    point = EYE[:3, 3] + 2.5 * EYE[:3, 2]
    corners = []
    for k in range(48):
        u = (k % 8 + np.array([0, 1, 1, 0])) * 20 - 0.5
        v = (k // 8 + np.array([0, 0, 1, 1])) * 20 - 0.5
        local = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(4)], axis=-1)
        directions = local @ EYE[:3, :3].T
        corners.append(EYE[:3, 3] + directions * ((point - EYE[:3, 3]) @ normal / (directions @ normal))[:, None])
    expected_m = plane_depth(CAMERA, EYE, point, normal)
    assert np.ptp(expected_m) > 2
    frames = {}
    for samples in (1, 8, 1) if engine == "workbench" else (1, 1):  # EEVEE takes seconds for 8
        frame = render(quads_mesh(corners, colours), replace(OPTIONS, engine=engine, samples=samples))
        inner = rgb_bytes(frame.rgb).reshape(6, 20, 8, 20, 3)[:, 4:-4, :, 4:-4].astype(int)
        assert np.abs(inner - colours.reshape(6, 1, 8, 1, 3)).max() <= 1, f"{samples} samples"
        within = np.s_[2:-2, 2:-2]  # at the image's border the board ends
        assert (np.abs(frame.depth_m - expected_m) / expected_m)[within].max() < 2e-4, f"{samples} samples"
        made = frame.rgb.tobytes() + frame.depth_m.tobytes()
        assert frames.setdefault(samples, made) == made, "the same again gives other bytes"


@gl_engines
def test_void_is_void_and_black(engine):
    # A square 2 m away: what it covers follows from the intrinsics.
    square = EYE[:3, 3] + np.array([[-0.3, -0.3, 2], [0.3, -0.3, 2], [0.3, 0.3, 2], [-0.3, 0.3, 2]]) @ EYE[:3, :3].T
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    from_edge_px = np.maximum(
        np.abs(u - CAMERA.cx_px) - 0.15 * CAMERA.fx_px, np.abs(v - CAMERA.cy_px) - 0.15 * CAMERA.fy_px
    )
    for far_m in (3.0, 1000.0) if engine == "workbench" else (1000.0,):  # EEVEE takes more than a second to begin
        frame = render(quads_mesh([square], [[200, 100, 50]]), replace(OPTIONS, engine=engine, far_m=far_m))
        assert np.allclose(frame.depth_m[from_edge_px < -1], 2, rtol=2e-4)
        assert not frame.depth_m[from_edge_px > 1].any()
        assert not rgb_bytes(frame.rgb)[from_edge_px > 1].any()
    assert not render(quads_mesh([square]), replace(OPTIONS, engine=engine, far_m=1.5)).depth_m.any()


def test_a_single_modality_is_the_same_and_alone():
    mesh = box_mesh(np.array([-1.0, -1.2, -0.8]), np.array([3.0, 2.0, 1.5]))
    mesh = replace(mesh, rgb=np.random.default_rng(3).random((24, 3)).astype(np.float32))
    for samples in (1, 4):
        both = render(mesh, replace(OPTIONS, samples=samples))
        colour = render(mesh, replace(OPTIONS, samples=samples, channels={"rgb"}))
        depth = render(mesh, replace(OPTIONS, samples=samples, channels={"depth"}))
        assert not bpy.context.view_layer.use_pass_combined
        assert colour.depth_m is None
        assert depth.rgb is None
        assert np.array_equal(both.rgb, colour.rgb)
        assert np.array_equal(both.depth_m, depth.depth_m)


def test_without_gl_the_packages_are_named(monkeypatch):
    # What a machine without Mesa's drivers shows: no EGL device to be had.
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(NoisyWorldError, match=r"apt-get install .*libegl1") as error:
        gl_version()
    assert "\n" not in str(error.value)


def test_a_scratch_file_that_cannot_be_written_is_one_line(tmp_path):
    mesh = box_mesh(np.array([-1.0, -1.2, -0.8]), np.array([3.0, 2.0, 1.5]))
    paths = SensorPaths(evenly_stamped(EYE[None]))
    with Session(mesh, "test", paths, CAMERA, OPTIONS) as session:
        file = tmp_path / "file"
        file.write_text("in the way of a folder")
        bpy.context.scene.render.filepath = str(file / "frame.exr")
        with pytest.raises(StorageError, match="could not write its scratch file") as error:
            session.frame(paths.request(0))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["SOFTWARE", "NVIDIA"])
def test_a_compositor_on_a_card_is_of_that_card_and_software_is_none(kind, monkeypatch):
    told = SimpleNamespace(stdout=MARK + json.dumps(["Renderer", "4.6", kind]), returncode=0)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: told)
    if kind == "NVIDIA":
        assert compositor_card() == "Renderer, 4.6"
    else:
        refused(
            compositor_card, names=["render.compositor_device", "Renderer is software"], error=MissingDependencyError
        )


def card_problem():
    try:
        renderer_versions("cycles", "gpu")
    except MissingDependencyError as error:
        return str(error)
    return ""


@pytest.mark.skipif(not card_problem(), reason="there is a graphics card here")
def test_no_card_is_one_line():
    assert "render.device: cpu" in card_problem()
    assert "\n" not in card_problem()
    with pytest.raises(MissingDependencyError):
        render(box_mesh([-1, -1, -1], [2, 2, 2]), replace(OPTIONS, device="gpu"))


@pytest.mark.skipif(bool(card_problem()), reason="no graphics card here")
def test_depth_from_a_card():
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    point = np.array([0.0, 0.0, 2.0])
    eye = look_at([0.0, 0.0, 0.0], [0.1, 0.2, 1.0])
    depth_m = render(plane_mesh(point, normal, 50.0), replace(OPTIONS, device="gpu"), eye).depth_m
    assert np.abs(depth_m / plane_depth(CAMERA, eye, point, normal) - 1).max() < 1e-5
