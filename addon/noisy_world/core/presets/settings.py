# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a preset's settings: one, several by a sweep, or those of another preset."""

from dataclasses import dataclass
from typing import Any, Literal

from ..schema import key
from .names import safe_name, stream_name, template


@dataclass(frozen=True)
class SweepSpec:
    """Settings of one perturbation each: every name with every severity, mode and value of its parameters."""

    perturb: tuple[str, ...] = key("names of perturbations", identity="meaning")
    severities: tuple[float, ...] | None = key(
        "severities; without parameters 1, 2, 3, 4 and 5", default=None, minimum=1, maximum=5, identity="meaning"
    )
    modes: tuple[Literal["static", "dynamic"], ...] | None = key(
        "modes; static if none is given", default=None, identity="meaning"
    )
    parameters: Any = key(
        "lists of values of parameters, by name: {factor: [2, 4, 8]}", default=None, identity="meaning"
    )
    without: Any = key(
        "what is left out, a list such as [{rotation_deg: 0, translation_m: 0}]", default=None, identity="meaning"
    )
    name: str | None = key(
        "what each setting is called, with {perturb}, {severity}, {mode} and {any parameter}; needed with parameters, "
        "else fog_s3 and fog_s3_dynamic",
        default=None,
        pattern=template,
        identity="meaning",
    )
    stream: str | None = key(
        "as a setting's, with what name may have in braces: '{perturb}' lets all severities of one draw equal patterns",
        default=None,
        pattern=stream_name,
        identity="meaning",
    )


@dataclass(frozen=True)
class SettingSpec:
    """A setting of the benchmark: what is done to every scene; or a sweep or another preset, which make several."""

    name: str | None = key("the setting's folder in the dataset", default=None, pattern=safe_name, identity="meaning")
    perturb: tuple[Any, ...] = key(
        "perturbations, each {name: {severity, mode, levels, temporal, or parameters}}; see --list perturbations",
        default=(),
        identity="meaning",
    )
    stream: str | None = key(
        "the name under which its colour and depth draw random patterns; settings of one stream draw the same in the "
        "same frame, and share images; its own name if none is given",
        default=None,
        pattern=stream_name,
        identity="meaning",
    )
    sweep: SweepSpec | None = key("instead of name and perturb: settings by the dozen", default=None)
    include: str | None = key(
        "instead of all others: another preset, whose settings are taken", default=None, identity="meaning"
    )
    backend: Literal["compositor", "reference"] | None = key(
        "what executes this setting's perturbations of colour, where it is not the preset's",
        default=None,
        identity="meaning",
    )
