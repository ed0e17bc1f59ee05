# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's incremental reconstruction of a sequence, by pycolmap; a program of its own, in an environment of systems.

    .venv-slam/bin/python colmap_mono.py FRAMES OUT
    .venv-slam/bin/python colmap_mono.py --versions

It sees all frames before it places one, as no camera that moves can: a bound on what colour tells, not a competitor.
Features are matched between frames that are near in time, and at distances of 2, 4, 8 ... frames. Writes trajectory.txt
(TUM, camera-to-world, the registered frames, in a scale of its own) and frames.csv.
"""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np
import pycolmap  # pyright: ignore[reportMissingImports] - of the other environment
from frame_files import carry_out, rigid, write_estimate

FEATURES = 2000  # chosen: COLMAP's own 8192 are for photographs of some megapixels
NEIGHBOURS = 6  # chosen, of COLMAP's own 10: a frame's neighbours look nearly the same
FIRST_ANGLE_DEG = 4.0  # at least, between the two frames that begin: COLMAP's own 16 are for photographs apart
SEED = 1
CENTRE_PX = 0.5  # COLMAP's pixels have their centres at halves


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = ArgumentParser(prog="colmap_mono.py", description="Reconstruct a sequence by COLMAP.")
    return carry_out(arguments, parser, lambda: {"pycolmap": pycolmap.__version__, "numpy": np.__version__}, run)


def run(index: dict, out: Path, _: Namespace) -> None:
    """Reconstruct the frames, then write where their cameras were."""
    images = linked(index, out / "images")
    database = out / "database.db"
    match(index["camera"], images, out / "images", database)
    poses = reconstructed(images, out, database)
    write_estimate(out, index, poses)


def linked(index: dict, folder: Path) -> dict[str, int]:
    """Link the colour images into a folder, in the order of their names; return their frames' numbers by name."""
    folder.mkdir()
    names = {}
    for frame in index["frames"]:
        name = f"{frame['index']:06d}{Path(frame['colour']).suffix}"
        (folder / name).symlink_to(Path(frame["colour"]).resolve())
        names[name] = frame["index"]
    return names


def match(camera: dict, images: dict[str, int], folder: Path, database: Path) -> None:
    """Find and match features."""
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    centre = camera["cx"] + CENTRE_PX, camera["cy"] + CENTRE_PX
    reader.camera_params = ",".join(map(repr, (camera["fx"], camera["fy"], *centre)))
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads = 1
    extraction.sift.max_num_features = FEATURES
    pycolmap.extract_features(
        database,
        folder,
        image_names=list(images),
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = 1
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = NEIGHBOURS
    pycolmap.match_sequential(database, matching_options=matching, pairing_options=pairing, device=pycolmap.Device.cpu)


def reconstructed(images: dict[str, int], out: Path, database: Path) -> dict[int, np.ndarray]:
    """Return the poses (4, 4), c2w, of the frames in the one model that is reconstructed; none where there is none."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1
    options.random_seed = SEED
    options.multiple_models = False  # another one would have another origin and scale
    options.extract_colors = False
    options.mapper.init_min_tri_angle = FIRST_ANGLE_DEG
    options.ba_refine_focal_length = options.ba_refine_extra_params = False  # the camera is known
    (out / "model").mkdir()
    models = pycolmap.incremental_mapping(database, out / "images", out / "model", options=options)
    poses = {}
    for model in models.values():
        for image in model.images.values():
            if image.has_pose:
                c2w = image.cam_from_world().inverse()
                poses[images[image.name]] = rigid(c2w.rotation.matrix(), c2w.translation)
    return poses


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
