# SPDX-License-Identifier: GPL-3.0-or-later
"""Completing a dataset whose frames are all there: text files, overview, manifest."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from ..channels import surface_channels
from ..core.depth_range import RangeLoss, range_loss
from ..core.errors import Message, PresetKey
from ..core.file_access import canonical
from ..core.frame_request import SensorPaths
from ..core.frame_table import COMPLETED, FrameRecord
from ..core.trajectory import FrameStamps
from ..layouts import OutputFormat, SequenceFacts
from ..layouts.asl import imu_texts
from ..layouts.cam_params import stated_optics
from ..sources.scene_kinds import Scene
from ..trajectories.rig import ImuSamples, RecordedImu, Rig, measure
from .dataset_folder import Dataset
from .folder_state import OVERVIEW
from .frame import motion_of_frames
from .identity import cameras_agree, cameras_of, manifest, optics_of
from .overview import draw_overview
from .plan import Plan, Render
from .sequence import PlannedSequence, written_paths


def channel_texts(format_: OutputFormat, scene: Scene) -> dict[str, str]:
    """Return the files of a sequence that say what the values of its channels mean, by name."""
    texts: dict[str, str] = {}
    for item in surface_channels(format_.modalities):
        if not item.has_content:
            continue
        if (objects := scene.source.capabilities.objects) is not None:
            texts[f"{item.name}.json"] = canonical(item.content_of(objects()))
        elif (mesh := scene.source.mesh) is not None:
            texts[f"{item.name}.json"] = canonical(item.content(mesh(), scene.source.location))
    return texts


def _recorded_imu(plan: Plan, render: Render, sequence: PlannedSequence) -> RecordedImu | None:
    """Return the IMU of a recording, as it was recorded; None where its path is another in this sequence."""
    return None if plan.rig is not None or sequence.skips else render.scene.source.capabilities.imu


def _imu_samples(plan: Plan, sequence: PlannedSequence, paths: SensorPaths, stamps: FrameStamps) -> ImuSamples | None:
    """Return what the rig's IMU measures along a sequence's whole path; None without one.

    It draws by seed and scene alone: settings that follow the same path have the same samples.
    """
    if plan.rig is None or plan.rig.imu is None or paths.robot is None:
        return None
    return measure(paths.robot, plan.rig.imu, stamps.pose.ns[0], (plan.preset.spec.seed, sequence.scene))


def _completed_shares(records: Mapping[int, FrameRecord]) -> dict[int, float]:
    """Return by frame the share of depth that was completed for its colour, of frames of which some was."""
    return {
        frame: record.perturbed[COMPLETED]["share"]
        for frame, record in records.items()
        if COMPLETED in record.perturbed
    }


class Completion:
    """Writes what a dataset has beside its images."""

    def __init__(
        self,
        plan: Plan,
        dataset: Dataset,
        paths_of: Callable[[Render], SensorPaths],
        note: Callable[[str], None],
    ) -> None:
        """Take a dataset that is open. paths_of: returns the sensors' paths in a render. note: tells the user."""
        self._plan = plan
        self._dataset = dataset
        self._paths_of = paths_of
        self._note = note

    def write(self) -> str:
        """Write the text files beside the images, and the manifest; return the manifest's SHA-256."""
        self._dataset.read_on()
        files: dict[str, object] = {}
        counts: dict[str, int] = {}
        pictured: dict[str, list[int]] = {}
        losses: dict[str, RangeLoss] = {}
        completed: dict[str, dict[int, float]] = {}
        format_ = self._plan.format
        one_camera = cameras_agree(self._dataset.identity)
        for render in self._plan.renders:
            for sequence in render.sequences:
                records = self._finished_frames(render, sequence)
                if not records:
                    continue  # --frames chose none of it
                if motion := motion_of_frames(render, sequence, self._paths_of(render)):
                    records = {frame: record.with_motion(motion[frame]) for frame, record in records.items()}
                paths = written_paths(sequence, self._paths_of(render))
                stamps = render.scene.source.frame_stamps
                frames = tuple(records)
                rig, imu = self._written_rig(render), _imu_samples(self._plan, sequence, paths, stamps)
                if (recorded := _recorded_imu(self._plan, render, sequence)) is not None:
                    rig, imu = recorded.rig, recorded.samples
                exposed_s = render.scene.source.capabilities.exposures_s
                if exposed_s is not None:
                    exposed_s = exposed_s[[sequence.source_of("rgb", frame) for frame in frames]]
                facts = SequenceFacts(
                    *(format_, render.camera, rig, frames, paths, stamps, render.optics, imu), exposures_s=exposed_s
                )
                texts = format_.layout.sequence_texts(facts) | imu_texts(facts)
                texts |= channel_texts(format_, render.scene)
                if not one_camera:
                    texts |= format_.setting_texts(render.camera, render.optics)
                files[sequence.folder] = self._dataset.finish_sequence(sequence.folder, texts, records.values())
                counts[sequence.folder] = len(records)
                pictured[sequence.folder] = list(records)
                images = (record.out_of_range for record in records.values())
                if loss := range_loss(images, self._pixels(sequence.scene)):
                    losses[sequence.folder] = loss
                completed.setdefault(sequence.scene, {}).update(_completed_shares(records))
        files |= {} if one_camera else self._texts_beside()
        first = self._plan.renders[0]
        of_setting = format_.setting_texts(first.camera, first.optics) if one_camera else {}
        for setting in {folder.split("/")[0]: None for folder in counts}:
            for name, text in of_setting.items():
                path = f"{setting}/{name}"
                files[path] = self._dataset.write_text(path, text)
        if self._plan.preset.spec.output.overview:
            stamps_of = {scene.name: scene.source.frame_stamps for scene in self._plan.scenes}
            picture = draw_overview(self._dataset.out, format_, pictured, stamps_of)
            files[OVERVIEW] = self._dataset.write_bytes(OVERVIEW, picture)
        digest = self._dataset.write_manifest(manifest(self._plan, self._dataset.identity, files, counts, losses))
        self._note_losses(losses, counts)
        self._note_completed(completed)
        return digest

    def _note_completed(self, shares: dict[str, dict[int, float]]) -> None:
        """Say in a note for each scene how much of the depth that colour depends on was not measured."""
        for scene, by_frame in shares.items():
            if not by_frame:
                continue
            mean, most = sum(by_frame.values()) / len(by_frame), max(by_frame.values())
            text = (
                f"{scene}: {mean:.1%} of the depth that colour depends on is void, not measured (at most {most:.1%} of "
                "a frame): it counts as far as what was measured around it, or as the sky with "
            )
            self._note(Message(text, PresetKey("void", "sky")))

    def _written_rig(self, render: Render) -> Rig | None:
        """Return the rig whose sensors' poses are those of the images: registered depth is where colour is."""
        rig = self._plan.rig
        return replace(rig, depth=None) if rig is not None and render.registers else rig

    def _note_losses(self, losses: dict[str, RangeLoss], counts: dict[str, int]) -> None:
        """Say in a note for each scene how much of its depth is lost, and what keeps it."""
        for scene in self._plan.scenes:
            of_scene = [sequence for sequence in self._plan.sequences if sequence.scene == scene.name]
            lost = {item.setting.name: losses[item.folder] for item in of_scene if item.folder in losses}
            frames = {item.setting.name: counts[item.folder] for item in of_scene if item.folder in losses}
            if lost:
                self._note(Message(f"{scene.name}: ", self._plan.format.depth_range.format_scene_loss(lost, frames)))

    def _texts_beside(self) -> dict[str, object]:
        """Write the intrinsics of the sequences that stay beside the plan's: their settings' files no longer say them.

        Returns the files of these sequences by folder.
        """
        cameras = cameras_of(self._dataset.identity)
        optics = optics_of(self._dataset.identity)
        beyond = {name: stated_optics(self._dataset.out, content) for name, content in optics.items()}
        files: dict[str, object] = {}
        for folder, there in self._dataset.kept.items():
            scene = folder.split("/")[1]
            texts = self._plan.format.setting_texts(cameras[scene], beyond[scene])
            written = {name: self._dataset.write_text(f"{folder}/{name}", text) for name, text in texts.items()}
            files[folder] = there | written
        return files

    def _finished_frames(self, render: Render, sequence: PlannedSequence) -> dict[int, FrameRecord]:
        """Return the complete frames of a sequence, including those of earlier runs, and remove incomplete ones."""
        names = self._dataset.format.names(render.scene.source.frame_stamps)
        records = self._dataset.records(sequence.folder)
        whole = {frame: record for frame, record in records.items() if set(record.files) >= names.of(frame)}
        if lost := [frame for frame in sequence.frames if frame not in whole]:
            raise RuntimeError(f"{sequence.folder}: {len(lost)} frames were not made, {lost[0]} the first")
        self._dataset.drop_frames(sequence.folder, [records[frame] for frame in records.keys() - whole.keys()])
        return whole

    def _pixels(self, scene: str) -> int:
        """Return how many pixels a frame of a scene has."""
        camera = self._plan.depth_cameras[scene]
        return camera.width_px * camera.height_px
