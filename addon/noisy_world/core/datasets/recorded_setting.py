# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings and their steps as an identity holds them, in manifest.json, recipes and study.json: what writes them reads
them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from ..perturbing.given_files import deciding
from ..perturbing.steps import Setting, Step
from .json_text import finite_number, plain_values

KEYS = "keys"  # those of a preset that decide bytes by their own values

_WANTED = "is neither a mapping nor, with levels, a list of one for each"

Parameters: TypeAlias = Mapping[str, Any] | None
"""The parameters of one severity; None for 0, which is the identity."""


@dataclass(frozen=True)
class RecordedStep:
    """A step: what decides what it does to a frame.

    severity: None where only parameters or levels were given. levels: None of a static step. parameters: of its
    severity alone or, where it has levels, of each of them.
    """

    name: str
    severity: float | None
    levels: tuple[float, ...] | None
    parameters: tuple[Parameters, ...]
    temporal: str = "fresh"
    keyed: bool = False
    version: int = 1

    @property
    def mode(self) -> Literal["static", "dynamic", "keyed"]:
        """The mode, in a preset's words."""
        return "static" if self.levels is None else "keyed" if self.keyed else "dynamic"

    @classmethod
    def of(cls, step: Step[Any]) -> "RecordedStep":
        """Return the record of a step. Raises OSError where a file that is a parameter is gone."""
        severities = (step.severity,) if step.levels is None else step.levels
        return cls(
            step.perturbation.name,
            step.severity,
            step.levels,
            tuple(None if each == 0 else plain_values(deciding(step.parameters(each))) for each in severities),
            step.temporal,
            step.keyed,
            step.perturbation.version,
        )

    def content(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            "name": self.name,
            "severity": self.severity,
            "levels": None if self.levels is None else list(self.levels),
            **({"keyed": True} if self.keyed else {}),
            **({} if self.version == 1 else {"version": self.version}),
            "temporal": self.temporal,
            "parameters": self.parameters[0] if self.levels is None else list(self.parameters),
        }

    @classmethod
    def read(cls, content: Any) -> "RecordedStep":
        """Return the step that JSON holds. Raises ValueError with the key, and what is wrong with it."""
        _check(isinstance(content, dict), ": is no mapping")
        severity, levels, parameters = (content.get(key) for key in ("severity", "levels", "parameters"))
        name, temporal = content.get("name"), content.get("temporal", "fresh")
        keyed, version = content.get("keyed", False), content.get("version", 1)
        _check(isinstance(name, str), ".name: is no text")
        _check(severity is None or finite_number(severity) is not None, ".severity: is no number")
        listed = isinstance(levels, list) and bool(levels) and _are_numbers(levels)
        _check(levels is None or listed, ".levels: is no list of numbers")
        each = [parameters] if levels is None else parameters
        whole = isinstance(each, list) and len(each) == (1 if levels is None else len(levels))
        _check(whole and all(one is None or isinstance(one, dict) for one in each), f".parameters: {_WANTED}")
        _check(isinstance(temporal, str), ".temporal: is no text")
        _check(isinstance(keyed, bool), ".keyed: is neither true nor false")
        _check(type(version) is int, ".version: is no whole number")
        of_levels = None if levels is None else tuple(levels)
        return cls(name, severity, of_levels, tuple(each), temporal, keyed, version)


@dataclass(frozen=True)
class RecordedSetting:
    """A setting. stream: None is its own name. backend: None where no step acts on colour. sensor: steps of the rig's
    depth sensor, which its depth has before its own. keys: of its entry in the preset.
    """

    steps: tuple[RecordedStep, ...]
    sensor: tuple[RecordedStep, ...] = ()
    backend: str | None = None
    stream: str | None = None
    keys: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, setting: Setting) -> "RecordedSetting":
        """Return the record of a setting. Raises OSError where a file that is a parameter is gone."""
        return cls(
            tuple(map(RecordedStep.of, setting.steps)),
            tuple(map(RecordedStep.of, setting.sensor)),
            setting.backend if setting.rgb else None,
            None if setting.stream == setting.name else setting.stream,
            plain_values(dict(setting.keys)),
        )

    def content(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            **({} if self.stream is None else {"stream": self.stream}),
            "backend": self.backend,
            "steps": [step.content() for step in self.steps],
            **({"sensor": [step.content() for step in self.sensor]} if self.sensor else {}),
            **({KEYS: dict(self.keys)} if self.keys else {}),
        }

    @classmethod
    def read(cls, content: Any) -> "RecordedSetting":
        """Return the setting that JSON holds. Raises ValueError with the key, and what is wrong with it."""
        _check(isinstance(content, dict), "is no mapping")
        backend, stream, keys = content.get("backend"), content.get("stream"), content.get(KEYS, {})
        for key, value in (("backend", backend), ("stream", stream)):
            _check(value is None or isinstance(value, str), f"{key}: is no text")
        _check(isinstance(keys, dict), f"{KEYS}: is no mapping")
        return cls(_steps(content, "steps"), _steps({"sensor": [], **content}, "sensor"), backend, stream, keys)


def _steps(content: Mapping[str, Any], key: str) -> tuple[RecordedStep, ...]:
    listed: Any = content.get(key)
    _check(isinstance(listed, list), f"{key}: is no list")
    found: list[RecordedStep] = []
    for number, each in enumerate(listed):
        try:
            found.append(RecordedStep.read(each))
        except ValueError as error:
            raise ValueError(f"{key}.{number}{error}") from error
    return tuple(found)


def _check(right: bool, problem: str) -> None:
    if not right:
        raise ValueError(problem)


def _are_numbers(values: Iterable[object]) -> bool:
    return all(finite_number(value) is not None for value in values)


def setting_problem(name: str, content: Any) -> str:
    """Return the key and what is wrong with what JSON holds of the setting of a name, or ""."""
    try:
        RecordedSetting.read(content)
    except ValueError as error:
        return f"settings.{name}: {error}"
    return ""
