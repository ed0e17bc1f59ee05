# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a preset's `output`, derived from the registry of layouts."""

from collections.abc import Callable
from dataclasses import dataclass, fields, make_dataclass
from typing import TYPE_CHECKING, Any

from ..channels import CHANNELS
from ..channels.channel import FILE_KINDS
from ..datasets.layouts import LAYOUTS, Beyond, Colour, Image, Layout, OutputFormat
from ..schema import Choice, ConfigPath, key


def _defaults(of: Callable[[Layout], str]) -> str:
    """Return the layouts' defaults in words: "default jpg for replica, png for tum and euroc"."""
    names: dict[str, list[str]] = {}
    for name, layout in LAYOUTS.items():
        names.setdefault(of(layout), []).append(name)
    return "default " + ", ".join(f"{value} for {' and '.join(those)}" for value, those in names.items())


def _format_key(name: str) -> tuple[str, Any, Any]:
    kinds = CHANNELS[name].kinds
    choices = {kind: Choice(kind.upper(), FILE_KINDS[kind]) for kind in kinds}
    meaning = f"what files of {CHANNELS[name].spoken} are"
    return name, str, key(meaning, default=kinds[0], choices=choices, identity="meaning")


if TYPE_CHECKING:

    @dataclass(frozen=True)
    class FormatsSpec:
        """A field for each channel that may be stored in several ways, but colour, which has `image`."""

else:
    chosen = [name for name, item in CHANNELS.items() if item.steps is None and len(item.kinds) > 1]
    # Before Python 3.12 make_dataclass does not say where the class stands, and what stands nowhere cannot be pickled.
    named = {"__module__": __name__}
    FormatsSpec = make_dataclass("FormatsSpec", map(_format_key, chosen), frozen=True, namespace=named)


@dataclass(frozen=True)
class OutputSpec:
    """How the dataset is written."""

    layout: str = key(
        "the layout of the files; see --list layouts",
        default=next(iter(LAYOUTS)),
        choices={name: Choice(layout.label, layout.summary) for name, layout in LAYOUTS.items()},
        identity="meaning",
    )
    image: Image | None = key(
        "colour images; jpg is quality 98 without chroma subsampling; exr is scene-linear light as half floats, of "
        f"scenes with light of their own; {_defaults(lambda item: item.images[0])}",
        default=None,
        choices={
            "jpg": Choice("JPEG", "Quality 98 without chroma subsampling, as readers of Replica expect it"),
            "png": Choice("PNG", "Without loss"),
            "exr": Choice("EXR", "Scene-linear light before the view transform, as half floats"),
        },
        identity="meaning",
    )
    colour: Colour | None = key(
        "what colour images hold: red, green and blue, or one channel of grey (BT.601 weights on encoded values); "
        + _defaults(lambda item: item.colours[0]),
        default=None,
        choices={
            "rgb": Choice("Colour", "Red, green and blue"),
            "grey": Choice("Grey", "One channel, as systems for visual odometry read it"),
        },
        identity="meaning",
    )
    depth_scale_per_m: float | None = key(
        "steps of the 16-bit depth images a metre; " + _defaults(lambda item: f"{item.depth_scale_per_m:g}"),
        default=None,
        unit="steps/m",
        above=0,
        maximum=1e6,
        identity="meaning",
        slider=(100, 10_000),
    )
    depth_beyond: Beyond = key(
        "what becomes of depth that 16 bits do not hold: void, or the farthest that they do",
        default="void",
        choices={
            "void": Choice("Void", "No depth"),
            "farthest": Choice("Farthest", "The farthest depth that 16 bits hold"),
        },
        identity="meaning",
    )
    modalities: tuple[str, ...] = key(
        "the channels that are rendered and written; see --list channels",
        default=("rgb", "depth"),
        choices={name: Choice(item.label, item.meaning) for name, item in CHANNELS.items()},
        identity="meaning",
    )
    formats: FormatsSpec = key(
        "what files of channels are that keep values exactly, or in steps; of colour, image says it",
        default=FormatsSpec(),
        identity="meaning",
    )
    overview: bool = key(
        "whether to draw overview.png, a contact sheet of the dataset", default=False, identity="nothing"
    )
    licence: str | None = key(
        "the licence that a packed dataset states, such as cc-by-4.0; by default that of the scenes holds",
        default=None,
        identity="nothing",
    )

    @property
    def format(self) -> OutputFormat:
        """The format of the dataset; keys that are not given have the layout's defaults."""
        layout = LAYOUTS[self.layout]
        return OutputFormat(
            layout,
            self.image or layout.images[0],
            self.colour or layout.colours[0],
            self.modalities,
            self.depth_scale_per_m or layout.depth_scale_per_m,
            self.depth_beyond,
            tuple(
                (item.name, value)
                for item in fields(self.formats)
                if (value := getattr(self.formats, item.name)) != item.default
            ),
        )


def check_output(spec: OutputSpec, place: ConfigPath) -> None:
    """Check that the layout can have these keys' values. Raises InputError naming the key."""
    layout = LAYOUTS[spec.layout]
    for name, allowed in (("image", layout.images), ("colour", layout.colours)):
        given, known = getattr(spec, name), " or ".join(allowed)
        if given is not None and given not in allowed:
            raise place.at(name).error(
                f"is {given}, but the {layout.label} layout's readers expect {known}", f"use {known}"
            )
    if spec.image == "exr" and spec.colour == "grey":
        raise place.at("colour").error("is grey, but an EXR holds red, green and blue", "use rgb, or another image")
    if spec.licence is not None and not (spec.licence.strip() and spec.licence.isprintable()):
        raise place.at("licence").error("has to be one line of text", "name the licence, or leave the key out")
    if not spec.modalities or len(set(spec.modalities)) < len(spec.modalities):
        raise place.at("modalities").error(f"has to name channels, each once: {', '.join(CHANNELS)}")
