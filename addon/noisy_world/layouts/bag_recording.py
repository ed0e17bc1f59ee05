# SPDX-License-Identifier: GPL-3.0-or-later
"""A bag of ROS as a recording: which topics are its colour, depth, IMU and poses, and what they say together.

What is asked for is taken; else a topic is found where exactly one fits, and where several do they are listed. Stamps
are those of the messages' headers. The messages of the chosen topics are looked through once, in the order of the file:
of images their heads alone.
"""

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey, did_you_mean, one_line
from ..core.geometry import invert_pose, pose, rotation_from_quat_wxyz
from ..core.lens import DepthCamera, Distortion, Optics
from ..core.trajectory import NS_PER_S, FrameStamps, Stamps, Trajectory
from ..images.image_files import WholeFile, spoken, whole_image
from ..trajectories.rig import Imu, ImuModel, ImuSamples, RecordedImu, Rig, Sensor
from . import bag_messages as ros
from .bag_files import Bag, MessageRows
from .bag_messages import CameraInfo, ImageHead, MessageError, Moved
from .described import BagTopics
from .layout import MILLIMETRES
from .stored_recording import (
    PAIRING_S,
    PosePolicy,
    SizePx,
    StoredFrame,
    StoredSequence,
    associate,
    chosen_by_pose,
    same_camera,
    unposed,
)

NONE = "none"  # in place of a topic: there is to be none
LONGEST_GAP_NS = NS_PER_S  # chosen: between two poses, within which a path is interpolated
DEEPEST = 100  # frames of a chain from the world to the camera
Role: TypeAlias = Literal["rgb", "depth", "imu", "poses", "intrinsics"]
Float64: TypeAlias = NDArray[np.float64]
Int64: TypeAlias = NDArray[np.int64]


# --- topics ---


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of a bag. rows: its messages. head: of its first image, where it has images."""

    bag: Bag
    name: str
    kind: str
    encoding: str
    rows: MessageRows
    head: ImageHead | None = None

    @property
    def base(self) -> str:
        """The name without what transports of images put behind it."""
        return self.name.removesuffix("/compressedDepth").removesuffix("/compressed")

    def read(self, row: int, read: Callable[[bytes], Any], most: int | None = None) -> Any:
        """Return what is read of a message. Raises InputError, which names the bag, the topic and the message."""
        return ros.saying(self.bag.path, self.name, row, lambda: read(self.bag.data(self.rows, row, most)))

    def image_head(self, row: int) -> ImageHead:
        """Return the head of an image."""
        return self.read(row, lambda data: ros.image_head(data, self.kind, self.encoding), ros.HEAD_BYTES)


def topics_of(bag: Bag) -> dict[str, Topic]:
    """Return the topics that have messages of a kind that is read here, by name."""
    kinds = {ros.IMAGE, ros.COMPRESSED, ros.CAMERA, ros.IMU, *ros.TRANSFORMS, *ros.POSES}
    found: dict[str, Topic] = {}
    for item in bag.connections:
        if item.kind in kinds and item.count and item.topic not in found and item.encoding in ("ros1", "cdr"):
            of_kind = [other.number for other in bag.of_topic(item.topic) if other.kind == item.kind]
            rows = bag.rows.take(np.flatnonzero(np.isin(bag.rows.connection, of_kind)))
            found[item.topic] = Topic(bag, item.topic, item.kind, item.encoding, rows)
    return {name: _with_head(topic) for name, topic in found.items()}


def _with_head(topic: Topic) -> Topic:
    if topic.kind not in (ros.IMAGE, ros.COMPRESSED):
        return topic
    data = topic.bag.data(topic.rows, 0, ros.HEAD_BYTES)
    try:
        return replace(topic, head=ros.image_head(data, topic.kind, topic.encoding))
    except MessageError:
        return topic  # which says so where it is used


@dataclass(frozen=True, eq=False)
class Chooser:
    """Chooses topics of a bag. asked: by the preset."""

    bag: Bag
    topics: dict[str, Topic]
    asked: BagTopics

    def image(self, role: Literal["rgb", "depth"]) -> Topic | None:
        """Return the topic of colour or of depth; None where there is none."""
        fitting = [
            topic
            for topic in self.topics.values()
            if topic.kind in (ros.IMAGE, ros.COMPRESSED)
            and (topic.head is not None and topic.head.is_depth) == (role == "depth")
        ]
        of_base: dict[str, Topic] = {}
        for topic in sorted(fitting, key=lambda item: (item.kind != ros.IMAGE, item.name)):
            of_base.setdefault(topic.base, topic)  # what is there raw too is the same image
        return self._chosen(role, list(of_base.values()), (ros.IMAGE, ros.COMPRESSED))

    def plain(self, role: Role, kinds: Sequence[str]) -> Topic | None:
        """Return the one topic of some kinds."""
        return self._chosen(role, [topic for topic in self.topics.values() if topic.kind in kinds], kinds)

    def _chosen(self, role: Role, fitting: list[Topic], kinds: Sequence[str]) -> Topic | None:
        name = getattr(self.asked, role)
        if name == NONE:
            return None
        if name is not None:
            return self.named(role, name, kinds)
        if len(fitting) > 1:
            raise self.several(role, [topic.name for topic in fitting])
        return fitting[0] if fitting else None

    def several(self, role: Role, names: Iterable[str]) -> InputError:
        """Return the error of several topics that fit."""
        listed = ", ".join(sorted(names))
        key = PresetKey("scenes.sequence", f"{{bag: {self.bag.path.name}, {role}: TOPIC}}")
        remedy = Message("name one of them, or none, as in ", key)
        return InputError(self.bag.path, f"has several topics that may be {role}: {listed}", remedy=remedy)

    def named(self, role: Role, name: str, kinds: Sequence[str]) -> Topic:
        """Return the topic of a name. Raises InputError where the bag has none, or it is of another kind."""
        if (topic := self.topics.get(name)) is not None and topic.kind in kinds:
            return topic
        there = {item.topic: item for item in self.bag.connections}
        fit = ", ".join(sorted(topic.name for topic in self.topics.values() if topic.kind in kinds)) or "none"
        if name not in there:
            problem = f"has no topic {name[:200]} {did_you_mean(name, there)}".rstrip()
        elif not there[name].count:
            problem = f"has no message of {name[:200]}"
        elif there[name].encoding not in ("ros1", "cdr"):
            problem = f"has {name[:200]} written as {there[name].encoding[:40]!r}, and ros1 and cdr are read"
        else:
            problem = f"has {name[:200]} of the type {there[name].kind[:100]}, which is none for {role}"
        raise InputError(self.bag.path, problem, where=role, remedy=f"topics that fit: {fit[:400]}")


# --- frames and their poses ---


class _Numbers:
    """Numbers of many messages, with their stamps, in little memory."""

    def __init__(self) -> None:
        self.stamps = array("q")
        self.values = array("d")

    def add(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Add those of a message."""
        self.stamps.append(stamp_ns)
        self.values.extend(values)

    @property
    def arrays(self) -> tuple[Int64, Float64]:
        """Stamps (N,) and values (N, ...), in the order in which they were added."""
        stamps_ns = np.array(self.stamps, np.int64)
        return stamps_ns, np.array(self.values, np.float64).reshape(len(stamps_ns), -1)


@dataclass(eq=False)
class _Edge:
    parent: str
    static: bool = True
    numbers: _Numbers = field(default_factory=_Numbers)

    @cached_property
    def series(self) -> tuple[Int64, Float64]:
        """Stamps (N,), which increase, and values (N, 7); of equal stamps the last."""
        stamps_ns, values = self.numbers.arrays
        order = np.argsort(stamps_ns, kind="stable")
        stamps_ns, values = stamps_ns[order], values[order]
        last = np.append(np.diff(stamps_ns) > 0, True)
        return stamps_ns[last], values[last]

    @cached_property
    def still(self) -> bool:
        """Whether one pose holds for all times: it was sent as static, or again and again the same."""
        values = self.series[1]
        return self.static or (len(values) > 1 and bool((values == values[0]).all()))


class FrameTree:
    """Frames and where each is in its parent, as tf has them; static ones for all times."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.edges: dict[str, _Edge] = {}

    def add(self, moved: Moved, *, static: bool) -> None:
        """Add a transform. Raises InputError where its frame has another parent already."""
        edge = self.edges.setdefault(moved.child, _Edge(moved.parent))
        if edge.parent != moved.parent:
            problem = f"{moved.child[:80]} has two parents in tf: {edge.parent[:80]} and {moved.parent[:80]}"
            raise InputError(self.path, problem, remedy="take one of them out of the bag")
        if static and not edge.static:
            return
        if (edge.static and not static) or static:
            edge.numbers = _Numbers()
        edge.static = static
        edge.numbers.add(moved.stamp_ns, moved.values)

    def chain(self, frame: str) -> list[str]:
        """Return a frame and those above it, up to the root. Raises InputError where they go round."""
        found = [frame]
        while (edge := self.edges.get(found[-1])) is not None:
            if edge.parent in found or len(found) > DEEPEST:
                raise InputError(self.path, f"tf leads round in a circle at {edge.parent[:80]}", remedy="mend it")
            found.append(edge.parent)
        return found

    def moves(self, frame: str) -> bool:
        """Tell whether a frame moves in its root."""
        return any(name in self.edges and not self.edges[name].static for name in self.chain(frame))

    def pose_of(self, frame: str, within: str, times_ns: Int64) -> tuple[Float64, NDArray[np.bool_]] | None:
        """Return the poses (N, 4, 4) of a frame in another at times (N,), and whether each is known.

        None where no chain joins them.
        """
        up, down = self.chain(frame), self.chain(within)
        if up[-1] != down[-1]:
            return None
        shared = next(name for name in up if name in down)
        of_frame, known = self._up(up[: up.index(shared)], times_ns)
        of_within, known_too = self._up(down[: down.index(shared)], times_ns)
        return invert_pose(of_within) @ of_frame, known & known_too

    def _up(self, chain: list[str], times_ns: Int64) -> tuple[Float64, NDArray[np.bool_]]:
        poses, known = np.tile(np.eye(4), (len(times_ns), 1, 1)), np.ones(len(times_ns), np.bool_)
        for name in chain:
            edge = self.edges[name]
            stamps_ns, values = edge.series
            found, there = interpolated(stamps_ns, values, times_ns, static=edge.still)
            poses, known = found @ poses, known & there
        return poses, known


def interpolated(
    stamps_ns: Int64, values: Float64, times_ns: Int64, *, static: bool = False
) -> tuple[Float64, NDArray[np.bool_]]:
    """Return poses (N, 4, 4) at times (N,) between stamped ones, and whether each is known.

    values: (M, 7) translations and quaternions with w last, at stamps (M,), which increase. Places are interpolated on
    a line, rotations along the shorter great circle; at a stamp its own pose is kept. Beyond the first and the last
    stamp, and in a gap of more than a second, none is known. static: the first holds for all times.
    """
    quats = values[:, [6, 3, 4, 5]]
    quats = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    if static:
        one = pose(rotation_from_quat_wxyz(quats[:1]), values[:1, :3])
        return np.tile(one[0], (len(times_ns), 1, 1)), np.ones(len(times_ns), np.bool_)
    after = np.clip(np.searchsorted(stamps_ns, times_ns), 0, len(stamps_ns) - 1)
    exact = stamps_ns[after] == times_ns
    before = np.where(exact, after, np.maximum(after - 1, 0))
    gap_ns = stamps_ns[after] - stamps_ns[before]
    inside = (times_ns >= stamps_ns[0]) & (times_ns <= stamps_ns[-1])
    known = exact | (inside & (gap_ns <= LONGEST_GAP_NS))
    share = np.where(exact, 0.0, (times_ns - stamps_ns[before]) / np.maximum(gap_ns, 1))
    share = np.clip(share, 0.0, 1.0)[:, None]
    one, other = quats[before], quats[after]
    cosine = np.sum(one * other, axis=1, keepdims=True)
    other = np.where(cosine < 0, -other, other)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    near = angle < 1e-6
    divisor = np.where(near, 1.0, np.sin(angle))
    turned = np.where(near, 1 - share, np.sin((1 - share) * angle) / divisor) * one
    turned = turned + np.where(near, share, np.sin(share * angle) / divisor) * other
    place = values[before, :3] * (1 - share) + values[after, :3] * share
    return pose(rotation_from_quat_wxyz(turned), place), known


# --- the recording ---


@dataclass(frozen=True)
class BagFrame(StoredFrame):
    """A frame of a bag. rows: of its colour and its depth in their topics."""

    sequence: "BagSequence | None" = None
    rows: tuple[int, int] = (0, 0)

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB. Raises InputError, which names the topic and the message, where it is damaged."""
        assert self.sequence is not None
        return self.sequence.colour(self.rows[0])

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError as `rgb` does."""
        assert self.sequence is not None
        return self.sequence.measured_m(self.rows[1])

    @property
    def light(self) -> NDArray[np.float32]:
        """None is in a bag."""
        raise InputError(self.rgb_file, "holds no scene-linear light")

    def whole_file(self, modality: str) -> WholeFile:
        """None is in a bag: its images are in no files of their own."""
        raise InputError(self.rgb_file, f"holds {modality} in no file of its own")


@dataclass(frozen=True)
class BagSequence(StoredSequence):
    """A recording in a bag. rgb, depth: the topics. of_rgb, of_depth: each frame's messages in them.

    rgb_heads: of the former. rgb_info, depth_info: the topics of cameras. told: by what they are for, the topics that
    are read, and the frame of poses where it is asked for.
    """

    rgb: Topic | None = None
    depth: Topic | None = None
    of_rgb: tuple[int, ...] = ()
    of_depth: tuple[int, ...] = ()
    rgb_heads: tuple[ImageHead, ...] = ()
    rgb_info: Topic | None = None
    depth_info: Topic | None = None
    told: Mapping[str, str] = field(default_factory=dict)

    @property
    def bag(self) -> Bag:
        """The bag."""
        assert self.rgb is not None
        return self.rgb.bag

    @cached_property
    def size_px(self) -> SizePx:
        """Width and height of the first image in pixels."""
        return self.image_size(self.rgb, self.of_rgb[0])

    def image_size(self, topic: Topic | None, row: int) -> SizePx:
        """Return the width and height of an image in pixels."""
        assert topic is not None
        head = topic.image_head(row)
        if head.size_px is not None:
            return head.size_px
        return topic.read(row, lambda data: _compressed_size(ros.image_head(data, topic.kind, topic.encoding), data))

    @cached_property
    def image_notes(self) -> tuple[str, ...]:
        """What the user should know of its images. Raises InputError where one has another size than the first."""
        assert self.rgb is not None
        for row, head in zip(self.of_rgb, self.rgb_heads, strict=True):
            self._check_size(self.rgb, row, head.size_px or self.size_px, self.size_px)
        forms = {head.encoding for head in self.rgb_heads}
        notes = [
            f"colour is {form}: it is made RGB" for form in sorted(forms) if form.startswith(("bayer", "yuv", "uyvy"))
        ]
        if forms <= {"mono8", "8UC1"}:
            notes.append("colour is grey: perturbations get three equal channels")
        return tuple(map(one_line, notes))

    def _check_size(self, topic: Topic, row: int, size_px: SizePx, wanted: SizePx) -> None:
        if size_px != wanted:
            problem = f"message {row} is {spoken(size_px)} pixels, but {spoken(wanted)} are expected"
            raise InputError(self.folder, problem, where=topic.name, remedy="a sequence has one size")

    def colour(self, row: int) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return the colour (H, W, 3) of a message of its topic."""
        topic = self.rgb
        assert topic is not None
        found = topic.read(row, lambda data: ros.colour_of(ros.image_head(data, topic.kind, topic.encoding), data))
        self._check_size(topic, row, found.shape[1::-1], self.size_px)
        return found

    def encoded_colour(self, index: int) -> bytes:
        """Return the image that a frame's message of colour holds; b"" where it is raw."""
        topic = self.rgb
        assert topic is not None

        def image(data: bytes) -> bytes:
            head = ros.image_head(data, topic.kind, topic.encoding)
            return data[head.start : head.start + head.length] if head.compressed else b""

        return topic.read(self.of_rgb[index], image)

    def measured_m(self, row: int) -> NDArray[np.float32]:
        """Return the depth (H, W) in metres of a message of its topic."""
        topic = self.depth
        assert topic is not None
        scale = self.depth_scale_per_m
        found = topic.read(
            row, lambda data: ros.depth_of(ros.image_head(data, topic.kind, topic.encoding), data, scale)
        )
        self._check_size(topic, row, found.shape[::-1], self.depth_size_px)
        return found

    def frame(self, index: int) -> BagFrame:
        """Return a frame, whose images are read on request."""
        at = self.of_depth[index] if self.depth is not None else 0
        path = self.folder
        return BagFrame(
            path,
            None if self.depth is None else path,
            self.depth_scale_per_m,
            self.size_px,
            depth_size_px=self.depth_size_px,
            sequence=self,
            rows=(self.of_rgb[index], at),
        )


def _compressed_size(head: ImageHead, data: bytes) -> SizePx:
    payload = data[head.start : head.start + head.length]
    try:
        return whole_image(payload[12:] if "compressedDepth" in head.encoding else payload)[0].size_px
    except ValueError as error:
        raise MessageError(str(error)) from None


@dataclass(eq=False)
class _Seen:
    """What one look through the chosen topics found."""

    rgb: list[tuple[int, ImageHead]] = field(default_factory=list)
    depth: list[tuple[int, ImageHead]] = field(default_factory=list)
    imu: _Numbers = field(default_factory=_Numbers)
    imu_frame: str = ""
    poses: _Edge = field(default_factory=lambda: _Edge("", static=False))
    bodies: set[str] = field(default_factory=set)


def read_bag_sequence(
    path: Path, asked: BagTopics, poses: PosePolicy = "drop", depth_scale_per_m: float | None = None
) -> BagSequence:
    """Find what a bag records. asked: topics; depth_scale_per_m: steps a metre of depth in whole numbers, else 1000.

    poses: what becomes of frames without a pose. Raises InputError where it is no bag, no topic or several fit, and
    where messages are not what their types say.
    """
    bag = Bag(path)
    topics = topics_of(bag)
    chooser = Chooser(bag, topics, asked)
    rgb, depth = chooser.image("rgb"), chooser.image("depth")
    if rgb is None:
        there = ", ".join(f"{item.topic} ({item.kind})" for item in bag.connections) or "nothing"
        raise InputError(path, "has no topic with colour images", remedy=f"it holds {there[:400]}")
    imu = chooser.plain("imu", (ros.IMU,))
    tree = FrameTree(path)
    moved = _pose_topic(chooser, poses)
    seen = _look(topics, tree, {"rgb": rgb, "depth": depth, "imu": imu, "poses": moved})
    return _Assembly(chooser, tree, seen, rgb, depth, imu, moved).sequence(poses, depth_scale_per_m or MILLIMETRES)


def _pose_topic(chooser: Chooser, policy: PosePolicy) -> Topic | None:
    """Return the topic of poses that is asked for or the only one; None for tf, or none at all."""
    name = chooser.asked.poses
    if policy == "none" or name == NONE:
        return None
    if name is not None:
        found = chooser.named("poses", name, (*ros.POSES, *ros.TRANSFORMS))
        return None if found.kind in ros.TRANSFORMS else found
    fitting = [topic for topic in chooser.topics.values() if topic.kind in ros.POSES]
    return fitting[0] if len(fitting) == 1 else None  # of several, _Assembly says which, tf among them


def _look(topics: dict[str, Topic], tree: FrameTree, chosen: dict[Role, Topic | None]) -> _Seen:
    """Look through the chosen topics and tf, in the order of the files, so that each chunk is read once."""
    seen = _Seen()
    readers: list[tuple[Topic, Callable[[int], None]]] = []

    def images(topic: Topic, into: list[tuple[int, ImageHead]]) -> Callable[[int], None]:
        return lambda row: into.append((row, topic.image_head(row)))

    def of_tf(topic: Topic) -> Callable[[int], None]:
        static = topic.name.endswith("tf_static")

        def read(row: int) -> None:
            for moved in topic.read(row, lambda data: ros.transforms(data, topic.encoding)):
                tree.add(moved, static=static)

        return read

    def samples(topic: Topic) -> Callable[[int], None]:
        def read(row: int) -> None:
            stamp_ns, frame, values = topic.read(row, lambda data: ros.imu_sample(data, topic.encoding))
            seen.imu.add(stamp_ns, values)
            seen.imu_frame = seen.imu_frame or frame

        return read

    def of_poses(topic: Topic) -> Callable[[int], None]:
        def read(row: int) -> None:
            moved: Moved = topic.read(row, lambda data: ros.stamped_pose(data, topic.kind, topic.encoding))
            seen.poses.numbers.add(moved.stamp_ns, moved.values)
            seen.bodies.add(moved.child)

        return read

    makers: dict[Role, Callable[[Topic], Callable[[int], None]]] = {
        "rgb": lambda topic: images(topic, seen.rgb),
        "depth": lambda topic: images(topic, seen.depth),
        "imu": samples,
        "poses": of_poses,
    }
    readers += [(topic, makers[role](topic)) for role, topic in chosen.items() if topic is not None]
    readers += [(topic, of_tf(topic)) for topic in topics.values() if topic.kind in ros.TRANSFORMS]
    who = np.concatenate([np.full(len(topic.rows), number) for number, (topic, _) in enumerate(readers)])
    rows = np.concatenate([np.arange(len(topic.rows)) for topic, _ in readers])
    places = [
        np.concatenate([getattr(topic.rows, name) for topic, _ in readers]) for name in ("offset", "chunk", "part")
    ]
    for at in np.lexsort(places).tolist():
        readers[who[at]][1](int(rows[at]))
    return seen


@dataclass(frozen=True, eq=False)
class _Assembly:
    """Puts together what was found."""

    chooser: Chooser
    tree: FrameTree
    seen: _Seen
    rgb: Topic
    depth: Topic | None
    imu: Topic | None
    moved: Topic | None

    @property
    def path(self) -> Path:
        """The bag."""
        return self.chooser.bag.path

    def sequence(self, policy: PosePolicy, depth_scale_per_m: float) -> BagSequence:
        """Return the recording."""
        notes: list[str] = []
        rgb_rows, rgb_ns, rgb_heads = self._ordered(self.rgb, self.seen.rgb, notes)
        depth_rows, depth_ns = (), np.zeros(0, np.int64)
        frame = rgb_heads[0].frame
        if self.depth is not None:
            rows, depth_ns, _ = self._ordered(self.depth, self.seen.depth, notes)
            try:
                here, there = associate(rgb_ns / NS_PER_S, depth_ns / NS_PER_S)
            except ValueError as error:
                raise InputError(self.path, str(error), where=self.depth.name) from None
            if not len(here):
                problem = f"no image of {self.rgb.name} and {self.depth.name} lie within {PAIRING_S} s of one another"
                spans = [f"{name}: {ns[0]} to {ns[-1]} ns" for name, ns in (("colour", rgb_ns), ("depth", depth_ns))]
                raise InputError(self.path, problem, remedy=", ".join(spans))
            if left := len(rgb_rows) - len(here):
                notes.append(
                    f"{left} of {len(rgb_rows)} colour images have no depth within {PAIRING_S} s, and are left out"
                )
            rgb_rows, rgb_ns, rgb_heads = rgb_rows[here], rgb_ns[here], [rgb_heads[at] for at in here]
            depth_rows, depth_ns = rows[there], depth_ns[there]
        path, truth_said = self._path(frame, rgb_ns, policy, notes)
        chosen, said = (np.arange(len(rgb_ns)), "") if path is None else chosen_by_pose(self.path, path[1], policy)
        notes += [said] if said else []
        taken = Stamps.of_ns(rgb_ns[chosen].tolist())
        trajectory = unposed(len(chosen)).at(slice(None), taken.seconds)
        if path is not None:
            trajectory = Trajectory(path[0][chosen], taken.seconds, posed=path[1][chosen])
        info = self._info("intrinsics", self.rgb, frame)
        lens, camera = self._camera(self.rgb, info)
        imu = self._imu(frame, notes)
        sequence = BagSequence(
            folder=self.path,
            rgb_files=(self.path,) * len(chosen),
            depth_files=(self.path,) * (0 if self.depth is None else len(chosen)),
            trajectory_path=self.path if truth_said else None,
            trajectory=trajectory,
            stamps=FrameStamps(taken, taken if self.depth is None else Stamps.of_ns(depth_ns[chosen].tolist()), taken),
            depth_scale_per_m=depth_scale_per_m,
            stamps_path=self.path,
            camera=camera,
            camera_path=None if camera is None else self.path,
            optics=Optics(distortion=lens),
            imu=imu,
            rgb=self.rgb,
            depth=self.depth,
            of_rgb=tuple(rgb_rows[chosen].tolist()),
            of_depth=() if self.depth is None else tuple(np.asarray(depth_rows)[chosen].tolist()),
            rgb_heads=tuple(rgb_heads[at] for at in chosen),
            rgb_info=None if info is None else info[0],
        )
        optics, of_depth = self._optics(sequence, lens, frame, notes)
        return replace(
            sequence,
            optics=optics,
            notes=tuple(map(one_line, notes)),
            depth_info=of_depth,
            told=self._told(truth_said, info),
        )

    def _told(self, truth: str, info: tuple[Topic, CameraInfo] | None) -> dict[str, str]:
        """Return the names of what is read, which with the bag's bytes decide what the recording is."""
        topics = {
            "rgb": self.rgb,
            "depth": self.depth,
            "imu": self.imu,
            "intrinsics": None if info is None else info[0],
        }
        names = {role: topic.name for role, topic in topics.items() if topic is not None}
        names |= {"poses": truth} if truth else {}
        return names | ({"body": self.chooser.asked.body} if truth and self.chooser.asked.body else {})

    def _ordered(
        self, topic: Topic, found: list[tuple[int, ImageHead]], notes: list[str]
    ) -> tuple[NDArray[np.intp], Int64, list[ImageHead]]:
        """Return the messages of images by their stamps, which increase; of two with one stamp, the first."""
        stamps_ns = np.array([head.stamp_ns for _, head in found], np.int64)
        if not stamps_ns.any():
            notes.append(f"headers of {topic.name} say no time: the times of recording are used")
            stamps_ns = topic.rows.log_ns[[row for row, _ in found]]
        order = np.argsort(stamps_ns, kind="stable")
        # Seconds in float64 are what paths are stamped by: what is one number there is one time.
        keep = order[np.append(True, np.diff(stamps_ns[order] / NS_PER_S) > 0)]
        if lost := len(order) - len(keep):
            notes.append(f"{lost} of {len(order)} images of {topic.name} have the stamp of another, and are left out")
        rows = np.array([row for row, _ in found], np.intp)
        return rows[keep], stamps_ns[keep], [found[at][1] for at in keep]

    # --- poses ---

    def _path(
        self, frame: str, times_ns: Int64, policy: PosePolicy, notes: list[str]
    ) -> tuple[tuple[Float64, NDArray[np.bool_]] | None, str]:
        """Return the camera's poses (N, 4, 4) and which are known, and the topic; None without ground truth."""
        asked = self.chooser.asked.poses
        if policy == "none" or asked == NONE:
            return None, ""
        from_tf = frame in self.tree.edges and self.tree.moves(frame)
        if asked is None:
            names = [topic.name for topic in self.chooser.topics.values() if topic.kind in ros.POSES]
            names += ["/tf"] if from_tf else []
            if len(names) > 1:
                raise self.chooser.several("poses", names)
            if not names:
                notes.append(f"nothing says where {frame or 'the camera'} is: it is a recording without ground truth")
                return None, ""
        if self.moved is None:
            if not from_tf:
                problem = (
                    f"tf does not lead from a frame that moves to {frame or 'the camera, whose frame has no name'}"
                )
                raise InputError(self.path, problem, where="/tf", remedy="poses: none uses the images alone")
            world = self.tree.chain(frame)[-1]
            found = self.tree.pose_of(frame, world, times_ns)
            assert found is not None, "the root of its chain"
            return found, "/tf"
        return self._by_topic(self.moved, frame, times_ns, notes), self.moved.name

    def _by_topic(
        self, topic: Topic, frame: str, times_ns: Int64, notes: list[str]
    ) -> tuple[Float64, NDArray[np.bool_]]:
        """Return the camera's poses by a topic of poses, and where the camera sits on what the topic tells of."""
        children = self.seen.bodies
        if len(children) > 1 and self.chooser.asked.body is None:
            listed = ", ".join(sorted(children))
            raise InputError(self.path, f"tells of several frames: {listed[:400]}", where=topic.name, remedy="use /tf")
        of_body, known = interpolated(*self.seen.poses.series, times_ns)
        body = self.chooser.asked.body or next(iter(children))
        if not body:
            notes.append(f"{topic.name} names no frame that it is of: its poses are taken to be the camera's own")
        if not body or body == frame:
            return of_body, known
        found = self.tree.pose_of(frame, body, times_ns)
        if found is None:
            problem = f"is of {body[:80]}, and tf does not lead from there to {frame[:80] or 'the camera'}"
            raise InputError(self.path, problem, where=topic.name, remedy="record /tf_static too, or use poses: none")
        return of_body @ found[0], known & found[1]

    # --- cameras ---

    def _info(self, role: Role, image: Topic, frame: str) -> tuple[Topic, CameraInfo] | None:
        """Return what is said of the camera of a topic's images: beside it, or the only one of its frame."""
        asked = self.chooser.asked.intrinsics if role == "intrinsics" and image is self.rgb else None
        if asked == NONE:
            return None
        if asked is not None:
            topic = self.chooser.named("intrinsics", asked, (ros.CAMERA,))
            return topic, self._read_info(topic)
        infos = [topic for topic in self.chooser.topics.values() if topic.kind == ros.CAMERA]
        beside = image.base.rpartition("/")[0] + "/camera_info"
        if (named := next((topic for topic in infos if topic.name == beside), None)) is not None:
            return named, self._read_info(named)
        same = [(topic, info) for topic in infos if (info := self._read_info(topic)).frame == frame and frame]
        if any(info != same[0][1] for _, info in same):
            if role == "depth":
                return None  # then depth has colour's camera, if it has its size
            raise self.chooser.several("intrinsics", [topic.name for topic, _ in same])
        return same[0] if same else None

    def _read_info(self, topic: Topic) -> CameraInfo:
        return topic.read(0, lambda data: ros.camera_info(data, topic.encoding))

    def _camera(self, image: Topic, found: tuple[Topic, CameraInfo] | None) -> tuple[Distortion | None, Any]:
        """Return the lens and the pinhole of a topic's images; of rectified ones, that of their projection."""
        if found is None:
            return None, None
        info = found[1]
        if "rect" in image.base.rpartition("/")[2] and info.rectified is not None:
            return None, info.rectified
        return info.lens, info.camera

    def _optics(
        self, sequence: BagSequence, lens: Distortion | None, frame: str, notes: list[str]
    ) -> tuple[Optics, Topic | None]:
        """Return the lens and depth's own camera, where there are such, and the topic that says the latter."""
        if self.depth is None:
            return Optics(distortion=lens), None
        head = self.depth.image_head(sequence.of_depth[0])
        info = self._info("depth", self.depth, head.frame)
        of_depth = None if info is None else info[0]
        own_lens, own = self._camera(self.depth, info)
        size_px = sequence.image_size(self.depth, sequence.of_depth[0])
        if own is None:
            if size_px != sequence.size_px:
                sizes = f"its images are {spoken(size_px)}, colour's {spoken(sequence.size_px)}"
                problem = f"{sizes}, and no camera_info says why"
                raise InputError(
                    self.path, problem, where=self.depth.name, remedy="name depth that is registered to colour"
                )
            return Optics(distortion=lens), of_depth
        place = None
        if head.frame != frame:
            found = self.tree.pose_of(head.frame, frame, np.array(sequence.stamps.rgb.ns[:1], np.int64))
            if found is None or not found[1].all():
                notes.append(f"nothing says where {head.frame} is beside {frame}: they are taken to be in one place")
            else:
                place = found[0][0]
        moved = place is not None and not np.allclose(place, np.eye(4), rtol=0, atol=1e-9)
        if sequence.camera is None or (same_camera(own, sequence.camera) and not moved):
            return Optics(distortion=lens), of_depth
        if own_lens is not None:
            notes.append(f"the lens of {self.depth.name} is left in its depth, which is taken to be a pinhole's")
        rows = tuple(tuple(row) for row in place.tolist()) if moved and place is not None else None
        return Optics(DepthCamera(own, rows), lens), of_depth

    # --- the IMU ---

    def _imu(self, frame: str, notes: list[str]) -> RecordedImu | None:
        if self.imu is None:
            return None
        stamps_ns, values = self.seen.imu.arrays
        if not np.isfinite(values).all():
            at = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise InputError(self.path, f"message {at} holds what is no finite number", where=self.imu.name)
        steps_s = np.diff(stamps_ns) / NS_PER_S
        rate_hz = 1.0 / float(np.median(steps_s)) if len(steps_s) and np.median(steps_s) > 0 else Imu.rate_hz
        own = self.seen.imu_frame
        of_rgb, found = np.eye(4), self.tree.pose_of(frame, own, stamps_ns[:1])
        if found is not None and found[1].all():
            of_rgb = found[0][0]
        else:
            both = f"{frame or 'the camera'} is beside {own or 'the IMU'}"
            notes.append(f"nothing says where {both}: they are taken to be in one place")
        imu = Imu(np.eye(4), ImuModel(), rate_hz)
        samples = ImuSamples(imu, stamps_ns, values[:, :3], values[:, 3:])
        return RecordedImu(Rig(Sensor(of_rgb), None, imu), samples, self.path)
