# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe held against what is here: as a plan that makes it again, and against a dataset, every file hashed."""

import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

from ..core.errors import InputError, one_line
from ..core.file_access import plain_values
from ..core.frame_table import FRAMES, FrameRecord
from ..core.progress import Progress, counted
from ..perturbations import registry
from ..perturbations.shares import MASK, sha256_of
from ..perturbations.steps import Setting, files_of
from ..preset.keys import Preset, check_document
from ..preset.names import chosen_part
from ..sources import read_scenes
from ..sources.scene_kinds import Scene
from .folder_state import MANIFEST, DatasetState, was_is
from .identity import (
    HUFFMAN,
    RecordedSetting,
    base_versions,
    path_sha256,
    processor,
    relevant_entry,
    same_version,
)
from .plan import Plan, Render, make_plan, needed_sources, read_settings
from .recipe import (
    Digests,
    FrameNumbers,
    Recipe,
    SequenceDigests,
    block_digests,
    block_slice,
    blocks_of,
    series_of,
    short_of_hex,
)
from .stored import SequenceFiles, StoredDataset, stored_dataset

# Checks that a scene's inputs are those that a recipe was made from.


HASHED = "_sha256"


def different_input(wanted: Mapping[str, Any], here: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first key in which the inputs of a scene differ, with both values in words; None where none does.

    A file may be called otherwise, if it is the same.
    """
    for name in sorted({*wanted, *here}):
        hashed = f"{name}{HASHED}"
        renamed = bool(wanted.get(hashed)) and wanted.get(hashed) == here.get(hashed)
        if wanted.get(name) != here.get(name) and not renamed:
            return name, f"is {_format_value(here.get(name))}, and the recipe's {_format_value(wanted.get(name))}"
    return None


def check_inputs(file: Path, wanted: Mapping[str, Any], scene: Scene) -> None:
    """Raise InputError where a scene's files are not those that a recipe was made from.

    file: the recipe. wanted: the scene in its identity.
    """
    here = plain_values(scene.source.hashes())
    if found := different_input(wanted["inputs"], here):
        name, difference = found
        key = name.removesuffix(HASHED)
        named, location = f"{here.get(key, key)}", scene.source.location
        what = location if Path(location).name == named else named
        problem = f"{what} is not what the recipe was made from: its {name} {difference}"
        raise InputError(file, problem, where=f"scenes: {scene.name}", remedy="--data DIR names the folder of another")


def check_setting(file: Path, wanted: Mapping[str, Any], setting: Setting) -> None:
    """Raise InputError where the files of a setting's steps are not those that a recipe was made from.

    file: the recipe. wanted: the setting in its identity.
    """
    recorded = RecordedSetting.read(wanted)
    for step, made in zip((*setting.sensor, *setting.steps), (*recorded.sensor, *recorded.steps), strict=False):
        severity = step.severity if step.levels is None else step.levels[0]
        parameters = {} if severity == 0 else files_of(step.parameters(severity))
        named = [
            (name, path, (made.parameters[0] or {}).get(name, {}).get("sha256")) for name, path in parameters.items()
        ]
        masks, wanted_masks = () if step.share is None else step.share.masks, made.share.get(MASK, ())
        named += [(MASK, path, there) for path, there in zip_longest(masks, wanted_masks) if path is not None]
        for name, path, there in named:
            here = sha256_of(path)
            if here != there:
                problem = f"{path} is not what the recipe was made from: its sha256 is {here[:12]}..."
                where = f"settings: {setting.name}: {step.perturbation.name}.{name}"
                raise InputError(file, problem, where=where, remedy="--data DIR names the folder of another")


def same_path(wanted: Mapping[str, Any], scene: Scene) -> bool:
    """Tell whether a scene has the recipe's path to the last bit. wanted: the scene in its identity."""
    source, path = scene.source, wanted["path"]
    if len(source.stamps_s) != path["frames"]:
        return False
    return path_sha256(scene.path, source.stamps_s, path["frames"]) == path["sha256"]


def _format_value(value: object) -> str:
    return f"{value[:12]}..." if isinstance(value, str) and len(value) == 64 else repr(value)


NAMED = 4  # names that a message lists


def preset_of(
    recipe: Recipe, data: Path | None = None, scenes: Sequence[str] = (), settings: Sequence[str] = ()
) -> Preset:
    """Return the preset of a recipe.

    data: the folder that the paths of its scenes begin at; default the recipe's. scenes, settings: names or globs of
    those that are wanted, if not all. Raises InputError.
    """
    document: dict[str, Any] = dict(recipe.identity["preset"])
    document["data"] = str((recipe.path.parent if data is None else data).absolute())
    if (document.get("output") or {}).get("depth_range") == "scene":  # of a part of its scenes it would be another
        scale_per_m = recipe.identity["output"]["depth_scale_per_m"]
        document["output"] = {**document["output"], "depth_scale_per_m": scale_per_m}
    if only := chosen_part(scenes, settings):
        document["only"] = only
    return check_document(document, recipe.path)


def plan_of(
    recipe: Recipe,
    data: Path | None = None,
    scenes: Sequence[str] = (),
    settings: Sequence[str] = (),
    frames: slice | None = None,
) -> Plan:
    """Return the plan of a part of a recipe, with its inputs checked. frames: of each sequence, if not all.

    Raises InputError, with the file, where an input is missing or is not the one that the recipe was made from.
    """
    named = _named(recipe)
    if not named:
        raise InputError(recipe.path, "its preset names none of its sequences", remedy="it can only verify a dataset")
    whole_scenes, whole_settings = (list(dict.fromkeys(name.split("/")[part] for name in named)) for part in (1, 0))
    plan = make_plan(preset_of(recipe, data, scenes or whole_scenes, settings or whole_settings), frames)
    for scene in plan.scenes:
        check_inputs(recipe.path, recipe.identity["scenes"].get(scene.name, {"inputs": {}}), scene)
    for setting in plan.settings:
        if (wanted := recipe.identity["settings"].get(setting.name)) is not None:
            check_setting(recipe.path, wanted, setting)
    renders = tuple(filter(None, (_within(recipe, plan, render) for render in plan.renders)))
    if not renders:
        message = ", ".join(sequence.folder for sequence in plan.sequences[:NAMED])
        raise InputError(recipe.path, f"knows nothing of {message}", remedy=f"it holds {_listed(named)}")
    return replace(plan, renders=renders)


def _within(recipe: Recipe, plan: Plan, render: Render) -> Render | None:
    """Return a render for the sequences that the recipe holds; a dataset may have grown by some scenes of a setting."""
    sequences = tuple(item for item in render.sequences if item.folder in recipe.sequences)
    if sequences == render.sequences or not sequences:
        return render if sequences else None
    return replace(render, sequences=sequences, frames=needed_sources(sequences, plan.format.modalities))


def unnamed_sequences(recipe: Recipe) -> str:
    """Return which sequences of a recipe its preset does not name, in words; "" where it names all.

    A dataset that has grown was made with several presets, and keeps the last one. Raises InputError.
    """
    named = set(_named(recipe))
    return _listed(name for name in recipe.names if name not in named)


def _named(recipe: Recipe) -> list[str]:
    """Return the sequences of a recipe that its preset names."""
    preset = preset_of(recipe)
    settings = {setting.name for setting in read_settings(preset, registry())}
    entries = [relevant_entry(entry) for entry in read_scenes(preset)]
    scenes = {name for name, scene in recipe.identity["scenes"].items() if scene["entry"] in entries}
    parts = [(name, *name.split("/")) for name in recipe.names]
    return [name for name, setting, scene in parts if setting in settings and scene in scenes]


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:NAMED]) + (f" and {len(listed) - NAMED} more" if len(listed) > NAMED else "")


# Compares versions and processor with a recipe's; bytes are equal only where these are.


BOUND = "pixels may differ by 1/255, and by more where noise falls on the other side of a threshold"
TABLES = "noisy JPEG images have other Huffman tables than the recipe's, for the same pixels"


def made_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other bytes than a recipe's, "" where nothing does.

    recipe, here: identities. Versions of what only one of them needs do not count.
    """
    versions = {
        name: (recipe["versions"].get(name, "none"), version)
        for name, version in here["versions"].items()
        # Python itself decides no byte; deflate does since it compresses PNG files.
        if name != "python"
        and not same_version(name, recipe["versions"].get(name, version if name != "deflate" else None), version)
    }
    parts = [f"{name} {was_is(*pair)}" for name, pair in versions.items()]
    if other := _processor(recipe["processor"], here["processor"]):
        parts.append(other)
    return one_line(f"made with others than the recipe: {'; '.join(parts)}: {BOUND}") if parts else ""


def written_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other files of a dataset than a recipe's, "" where nothing does. Both: identities."""
    found = made_otherwise(recipe, here)
    if here["output"].get(HUFFMAN) == recipe["output"].get(HUFFMAN):
        return found
    return "; ".join([*([found] if found else []), TABLES])


def _processor(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    if there == here:
        return ""
    for key in ("machine", "byte_order"):
        if there[key] != here[key]:
            return f"processor {was_is(there[key], here[key])}"
    lacks, more = sorted({*there["features"]} - {*here["features"]}), sorted({*here["features"]} - {*there["features"]})
    lines = [f"{word} {', '.join(names)}" for word, names in (("without", lacks), ("with", more)) if names]
    return f"a processor {' and '.join(lines)}"


def made_here() -> dict[str, Any]:
    """Return what this process would make frames with, apart from what renders them, as an identity has it."""
    return {"versions": base_versions(), "processor": processor()}


# Verification of a dataset against a recipe: every file is hashed.
#
# A file that is not as the dataset's own record says is damaged; one that is, in a block whose digest differs, was made
# otherwise. A sequence or a frame that the dataset's manifest does not name is not missing: somebody made a part.


# The result of comparing a dataset with a recipe, and its text.


# What can be wrong, with the words for it; the first three are faults of the dataset whatever made it.
MISSING, DAMAGED, EXTRA, OTHER, NOT_COMPARABLE = "missing", "damaged", "extra", "other", "not comparable"
MEANINGS = {
    MISSING: "missing",
    DAMAGED: "damaged (not as it was written)",
    EXTRA: "extra (neither the recipe nor the dataset's records name it)",
    OTHER: "not as the recipe says",
    NOT_COMPARABLE: "not comparable (made with other versions or on another processor)",
}


@dataclass
class FolderFindings:
    """What was found in one folder.

    problems: the names of files, or series with their frames, by kind. checked: how many images are as the recipe says.
    alone: images that are as they were written, but whose block is not whole here, so that no digest tells of them;
    cut: the frames of the recipe from which they are cut out. absent: the recipe's frames that were not made here.
    unknown: frames, or all, that the recipe does not know.
    """

    folder: str
    problems: dict[str, list[str]] = field(default_factory=dict)
    checked: int = 0
    alone: int = 0
    cut: str = ""
    absent: int = 0
    unknown: int = 0

    def add(self, kind: str, name: str) -> None:
        """Note a file that is not as it should be."""
        self.problems.setdefault(kind, []).append(name)

    def lines(self) -> list[str]:
        """Return a line for each kind of problem."""
        found = [f"{self.folder}: {_named_files(names)}: {MEANINGS[kind]}" for kind, names in self.problems.items()]
        if self.unknown:
            found.append(f"{self.folder}: {counted(self.unknown, 'frame')} that the recipe does not know")
        return found


@dataclass
class Findings:
    """What was found in a whole dataset.

    made_otherwise: why its bytes may differ from the recipe's without a fault, or "". not_there: sequences of the
    recipe that the dataset was not made with. missing: those that it should have. unknown: those that the recipe does
    not know. rest: the folder itself.
    """

    made_otherwise: str = ""
    sequences: list[FolderFindings] = field(default_factory=list)
    not_there: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    rest: FolderFindings = field(default_factory=lambda: FolderFindings("."))

    @property
    def all_found(self) -> list[FolderFindings]:
        """The sequences and the rest."""
        return [*self.sequences, self.rest]

    def count(self, *kinds: str) -> int:
        """Return how many problems of some kinds there are."""
        return sum(len(found.problems.get(kind, ())) for found in self.all_found for kind in kinds)

    @property
    def sound(self) -> bool:
        """Whether nothing is missing, damaged or extra, whatever made it."""
        return not (self.missing or self.unknown or self.count(MISSING, DAMAGED, EXTRA, OTHER)) and not any(
            found.unknown for found in self.sequences
        )

    @property
    def as_the_recipe(self) -> bool:
        """Whether all that is there is as the recipe says."""
        return self.sound and not self.count(NOT_COMPARABLE)

    def lines(self) -> list[str]:
        """Return what is wrong, line by line."""
        lines = [line for found in self.all_found for line in found.lines()]
        lines += [f"{_named_files(self.missing)}: missing"] if self.missing else []
        lines += [f"{_named_files(self.unknown)}: not in the recipe"] if self.unknown else []
        return lines

    def summary_lines(self) -> list[str]:
        """Return what is there and what is not, line by line; the last one is the outcome."""
        there, absent = len(self.sequences), len(self.not_there)
        lines = []
        if absent:
            lines.append(f"a part of the recipe: {absent} of its {there + absent} sequences were not made here")
        if lacking := sum(found.absent for found in self.sequences):
            lines.append(f"a part of the recipe: {counted(lacking, 'frame')} of these sequences were not made here")
        alone = [found for found in self.sequences if found.alone]
        if alone:
            count = sum(found.alone for found in alone)
            problem = "could not be compared, only checked against the dataset's own records"
            lines.append(f"{count} images {problem}: their blocks need {alone[0].cut} whole")
        if self.made_otherwise:
            lines.append(self.made_otherwise)
        checked = sum(found.checked for found in self.sequences)
        lines.append(f"{counted(there, 'sequence')}, {counted(checked, 'image')} as the recipe says{self._outcome()}")
        return lines

    def _outcome(self) -> str:
        kinds = {kind: self.count(kind) for kind in MEANINGS if self.count(kind)}
        parts = [f"{count} {kind}" for kind, count in kinds.items()]
        parts += [f"{counted(len(self.missing), 'sequence')} missing"] if self.missing else []
        parts += [f"{counted(len(self.unknown), 'sequence')} unknown"] if self.unknown else []
        return "; " + ", ".join(parts) if parts else ""


def _named_files(names: Iterable[str]) -> str:
    listed = list(names)
    more = len(listed) - NAMED
    return one_line(", ".join(listed[:NAMED]) + (f" and {more} more" if more > 0 else ""))


def verify(recipe: Recipe, dataset: Path | str, progress: Progress, stop: threading.Event) -> Findings:
    """Hash every file of a dataset and compare it with a recipe.

    dataset: a folder, or the address of a packed dataset. stop: when set, InterruptedRunError is raised after the
    current sequence. Raises InputError where there is no dataset, StorageError where a store refuses.
    """
    files = stored_dataset(dataset)
    state = files.state
    here = state.identity
    findings = Findings("" if here is None else written_otherwise(recipe.identity, here))
    known = state.finished if state.manifest is not None else state.sequences
    there = {name for name in recipe.sequences if files.has(name)}
    findings.missing = sorted(known & set(recipe.sequences) - there)
    findings.not_there = sorted(set(recipe.sequences) - known - there)
    findings.unknown = sorted((files.recorded() | known) - set(recipe.sequences))
    progress.start("verifying", sum(len(recipe.sequences[name].frames) for name in there))
    for name, own in files.each(sorted(there), stop):
        found = _Sequence(name, recipe.sequences[name], own, state, bool(findings.made_otherwise)).compared()
        findings.sequences.append(found)
        if not found.problems and own.damaged_whole:
            findings.rest.add(
                DAMAGED, own.damaged_whole
            )  # in what no file of the dataset is: headers, samples' descriptions
        progress.advance(len(recipe.sequences[name].frames))
    progress.finish()
    _compare_rest(recipe, files, findings)
    return findings


@dataclass
class _Sequence:
    """A sequence of the recipe that has files."""

    name: str
    wanted: SequenceDigests
    files: SequenceFiles
    state: DatasetState
    made_otherwise: bool

    def compared(self) -> FolderFindings:
        """Hash its files, and return what was found."""
        found = FolderFindings(self.name)
        written: Mapping[str, str] = self.state.files.get(self.name, {})
        records = self.files.records
        (recorded,) = self.files.digests([FRAMES])
        intact = recorded is not None and written.get(FRAMES) in (None, recorded)
        frames = FrameNumbers.of(frame for frame in records if frame in self.wanted.frames)
        lacking = len(self.wanted.frames) - len(frames)
        if intact:
            found.absent = lacking  # the dataset's own records do not name them
        elif lacking:
            found.add(MISSING, f"{lacking} frames that {FRAMES} should name")
        found.unknown = len(records) - len(frames)
        self._compare_images(found, frames, records)
        whole = frames == self.wanted.frames and not found.unknown
        texts = {**dict.fromkeys(self.wanted.texts), **written}
        for text, digest in zip(sorted(texts), self.files.digests(sorted(texts)), strict=True):
            kind = self._text_problem(digest, written.get(text), self.wanted.texts.get(text) if whole else None)
            if kind:
                found.add(kind, text)
        named = {*texts, FRAMES} | {name for record in records.values() for name in record.files}
        for name in sorted(self.files.names() - named):
            found.add(EXTRA, name)
        return found

    def _compare_images(self, found: FolderFindings, frames: FrameNumbers, records: Mapping[int, FrameRecord]) -> None:
        wrong: dict[str, set[int]] = {series: set() for series in self.wanted.images}
        named = [(frame, name) for frame in frames for name in records[frame].files]
        digests = self.files.digests([name for _, name in named])
        for (frame, name), digest in zip(named, digests, strict=True):
            if digest == records[frame].files[name]:
                continue
            found.add(MISSING if digest is None else DAMAGED, name)
            wrong.setdefault(series_of(name), set()).add(frame)
        for series, wanted in self.wanted.images.items():
            files = {
                frame: (name, digest)
                for frame in frames
                for name, digest in records[frame].files.items()
                if series_of(name) == series
            }
            self._compare_blocks(found, series, wanted, files, wrong[series])

    def _compare_blocks(
        self, found: FolderFindings, series: str, wanted: Digests, files: Mapping[int, tuple[str, str]], wrong: set[int]
    ) -> None:
        """Compare a series block by block; what is missing or damaged has been told."""
        there = FrameNumbers.of(sorted(files))
        made = block_digests(files)
        for block in blocks_of(there):
            part, whole = there.within(block_slice(block)), self.wanted.frames.within(block_slice(block))
            damaged = sum(frame in wrong for frame in part)
            if part != whole:
                found.alone += len(part) - damaged
                found.cut = found.cut or f"frames {whole}"
            elif made[block] == wanted[block]:
                found.checked += len(part) - damaged
            else:
                found.add(NOT_COMPARABLE if self.made_otherwise else OTHER, f"{series} {whole}")

    def _text_problem(self, digest: str | None, written: str | None, wanted: str | None) -> str:
        """Return what is wrong with a text file. wanted: the recipe's digest, None where that is of other frames."""
        if digest is None:
            return MISSING
        if written is not None and digest != written:
            return DAMAGED
        if wanted is not None and short_of_hex(digest) != wanted:
            return NOT_COMPARABLE if self.made_otherwise else OTHER
        return ""


def _compare_rest(recipe: Recipe, files: StoredDataset, findings: Findings) -> None:
    """Compare the files beside the sequences, and look for what belongs to nothing."""
    state = files.state
    settings = {name.split("/")[0] for name in state.sequences}
    loose = {name: digest for name, digest in state.files.items() if isinstance(digest, str)}
    wanted = {name: digest for name, digest in recipe.texts.items() if name.split("/")[0] in settings}
    for name in sorted({*loose, *wanted}):
        digest = files.digest(name)
        if digest is None:
            findings.rest.add(MISSING, name)
        elif loose.get(name, digest) != digest:
            findings.rest.add(DAMAGED, name)
        elif name in wanted and short_of_hex(digest) != wanted[name]:
            findings.rest.add(NOT_COMPARABLE if findings.made_otherwise else OTHER, name)
    if state.manifest is None:
        findings.rest.add(MISSING, MANIFEST)
    for kind, names in zip((MISSING, DAMAGED), files.own_problems(check=True), strict=True):
        for name in names:
            findings.rest.add(kind, name)
    sequences = {*recipe.sequences, *state.sequences, *findings.unknown}
    for name in sorted(files.beside(sequences) - {*loose, *wanted}):
        findings.rest.add(EXTRA, name)
