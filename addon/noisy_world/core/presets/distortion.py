# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a lens that distorts, of a preset's camera or of a scene."""

from dataclasses import dataclass

from ..geometry import Intrinsics
from ..lens import lens_problem
from ..messages import Message, PresetKey
from ..optics import Distortion, DistortionModel, Optics
from ..schema import Choice, ConfigPath, key

_OF_PLANE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
EMBREE = PresetKey("render.engine", "embree")
OF_ANGLE = ("k1", "k2", "k3", "k4")
_LARGEST = 100.0  # of a coefficient; Azure Kinect's rational ones are below 10


def _coefficient(meaning: str) -> float:
    value: float = key(meaning, default=0.0, minimum=-_LARGEST, maximum=_LARGEST)
    return value


@dataclass(frozen=True)
class DistortionSpec:
    """A lens that distorts, by OpenCV's names; those of Kalibr and COLMAP are in the docs."""

    model: DistortionModel = key(
        "the lens's model: radial-tangential is Brown and Conrady's (OpenCV's, Kalibr's radtan), equidistant that of "
        "Kannala and Brandt (cv2.fisheye's, COLMAP's OPENCV_FISHEYE)",
        default="radial-tangential",
        choices={
            "radial-tangential": Choice("Radial-Tangential", "Brown and Conrady's: of most lenses"),
            "equidistant": Choice("Equidistant", "Kannala and Brandt's: of fisheyes"),
        },
    )
    k1: float = _coefficient("radial, by the square of the radius or the angle")
    k2: float = _coefficient("radial, by its 4th power")
    p1: float = _coefficient("tangential, down; of radial-tangential")
    p2: float = _coefficient("tangential, right; of radial-tangential")
    k3: float = _coefficient("radial, by its 6th power")
    k4: float = _coefficient("equidistant: by the 8th power; radial-tangential: the divisor's, by the square")
    k5: float = _coefficient("the divisor's, by the 4th power; of radial-tangential")
    k6: float = _coefficient("the divisor's, by the 6th power; of radial-tangential")
    undistort: bool = key(
        "whether frames that the lens has bent are made a pinhole's again, as a driver does: they are interpolated, "
        "and what the lens did not see is void",
        default=False,
    )

    @property
    def lens(self) -> Distortion | None:
        """The lens; None where all coefficients are 0."""
        names = OF_ANGLE if self.model == "equidistant" else _OF_PLANE
        values = [float(getattr(self, name)) for name in names]
        if not any(values):
            return None
        if self.model == "radial-tangential":
            values = values[: 8 if any(values[5:]) else 5 if values[4] else 4]
        return Distortion(self.model, tuple(values))

    @property
    def left(self) -> Optics:
        """What the cameras of frames through this lens have beyond one pinhole."""
        return Optics(distortion=None if self.undistort else self.lens)


def check_distortion(spec: DistortionSpec, place: ConfigPath) -> None:
    """Refuse coefficients that the model has not, and a lens that does nothing. Raises InputError."""
    if spec.model == "equidistant":
        for name in set(_OF_PLANE) - set(OF_ANGLE):
            if getattr(spec, name):
                raise place.at(name).error("goes with radial-tangential: equidistant has k1 to k4", "leave it out")
    if spec.lens is None:
        remedy = "give k1" if spec.model == "radial-tangential" else "give k1; 0.001 is nearly an ideal fisheye"
        raise place.error("has no coefficient that is not 0", remedy)


def sound_lens(spec: DistortionSpec, camera: Intrinsics, place: ConfigPath, *, all_around: bool = False) -> Distortion:
    """Return the lens. Raises InputError where it folds over within the image of the camera.

    all_around: whether rays may lead sideways and back.
    """
    lens = spec.lens
    assert lens is not None, "this has been checked"
    if problem := lens_problem(camera, lens, all_around=all_around):
        remedy = Message("lower its coefficients, or the field of view (greater fx and fy)")
        if not all_around and not lens_problem(camera, lens, all_around=True):
            remedy = Message("lower the field of view (greater fx and fy), or render a mesh with ", EMBREE)
        raise place.error(problem, remedy)
    return lens
