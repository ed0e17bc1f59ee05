# SPDX-License-Identifier: GPL-3.0-or-later
"""Sweeps over parameters, and settings that a preset takes from another one."""

from itertools import product

from refusals import refused
from cases import cases

from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import read_preset
from noisy_world.perturbations import registry

HEAD = "scenes: [{mesh: a.ply, trajectory: b.txt}]\n"


def settings_of(folder, text, name="p.yaml"):
    path = folder / name
    path.write_text(HEAD + f"settings: [{text}]\n")
    preset = read_preset(path)
    return parse_settings(preset.spec.settings, preset.setting_places, registry())


def same(one, other):
    """Whether two settings do the same, whatever they are called."""
    return [(step.perturbation, step.severity, step.levels, dict(step.given)) for step in one.steps] == [
        (step.perturbation, step.severity, step.levels, dict(step.given)) for step in other.steps
    ]


def test_parameters_are_swept_as_if_written_out(tmp_path):
    swept = settings_of(
        tmp_path, "{sweep: {perturb: [faster_motion], parameters: {factor: [2, 4]}, name: 'x{factor}'}}"
    )
    written = settings_of(
        tmp_path,
        "{name: x2, perturb: [{faster_motion: {factor: 2}}]}, {name: x4, perturb: [{faster_motion: {factor: 4}}]}",
    )
    assert [item.name for item in swept] == ["x2", "x4"]
    assert all(same(one, other) for one, other in zip(swept, written, strict=True))


def test_every_combination_but_those_left_out(tmp_path):
    text = (
        "{sweep: {perturb: [motion_deviation], parameters: {rotation_deg: [0, 1], translation_m: [0, 0.0125]}, "
        "without: [{rotation_deg: 0, translation_m: 0}], name: 'd_{rotation_deg}deg_{translation_m}m'}}"
    )
    assert [item.name for item in settings_of(tmp_path, text)] == ["d_0deg_0.0125m", "d_1deg_0m", "d_1deg_0.0125m"]


def test_modes_and_severities_go_with_parameters(tmp_path):
    sweep = "{perturb: [desync], parameters: {offset: [5, -2]}, modes: [static, dynamic], name: 'd{offset}_{mode}'}"
    found = settings_of(tmp_path, f"{{sweep: {sweep}}}")
    assert [item.name for item in found] == ["d5_static", "d-2_static", "d5_dynamic", "d-2_dynamic"]
    assert [dict(item.steps[0].given)["mode"] for item in found] == ["static"] * 2 + ["dynamic"] * 2
    sweep = "perturb: [fog], severities: [1, 3], parameters: {uniform: [true, false]}"
    found = settings_of(tmp_path, f"{{sweep: {{{sweep}, name: '{{perturb}}{{severity}}_{{uniform}}'}}}}")
    assert [item.name for item in found] == ["fog1_true", "fog1_false", "fog3_true", "fog3_false"]
    assert [item.steps[0].severity for item in found] == [1, 1, 3, 3]


def test_names_as_before_without_a_template(tmp_path):
    text = "{sweep: {perturb: [fog, snow], severities: [1, 2.5], modes: [static]}}, {sweep: {perturb: [frost]}}"
    wanted = [f"{name}_s{k:g}" for name, k in product(["fog", "snow"], [1, 2.5])] + [f"frost_s{k}" for k in range(1, 6)]
    assert [item.name for item in settings_of(tmp_path, text)] == wanted


@cases(
    ("sweep", "words"),
    [
        ("perturb: [faster_motion], parameters: {factor: [2]}", ("sweep.name: is missing; ", "'{perturb}_{factor}'")),
        (
            "perturb: [faster_motion], parameters: {factor: 2}, name: a",
            ("parameters.factor: ", "the number 2", " list"),
        ),
        ("perturb: [faster_motion], parameters: [2], name: a", ("parameters: is a list, ", " mapping of lists")),
        ("perturb: [faster_motion], parameters: {fact: [2]}, name: a", ("parameters.fact: ", " did you mean 'factor'")),
        (
            "perturb: [faster_motion], parameters: {factor: [2]}, modes: [static], name: a",
            r"modes: faster_motion has no",
        ),
        ("perturb: [faster_motion], parameters: {factor: [0]}, name: a", ("faster_motion.factor: ", "is 0")),
        ("perturb: [faster_motion], parameters: {factor: [2, 4]}, name: a", "settings.0: 'a' is given twice"),
        ("perturb: [faster_motion], parameters: {factor: [2]}, name: 'x{fcator}'", ("sweep.name: ", " mean 'factor'")),
        ("perturb: [faster_motion], parameters: {factor: [2]}, name: '../{factor}'", "sweep.name: is '../x'"),
        ("perturb: [faster_motion], severities: [1]", ("has no severities to sweep over; ", "parameters: {factor:")),
        ("perturb: [fog], severities: []", "sweep.severities: is empty"),
        ("perturb: [fog], without: [{severity: 9}]", ("sweep.without.0: ", "leaves nothing out")),
        ("perturb: [fog], without: [{sevrity: 1}]", ("sweep.without.0: ", "'sevrity'", "'severity'")),
        ("perturb: [fog], without: 3", ("sweep.without: ", "list")),
        (
            f"perturb: [desync], parameters: {{offset: [{'1, ' * 200}], mode: [{'static, ' * 200}]}}, name: a",
            "makes 40000 settings",
        ),
    ],
)
def test_sweeps_that_are_refused(tmp_path, sweep, words):
    refused(settings_of, tmp_path, f"{{sweep: {{{sweep}}}}}", names=words)


# --- settings of another preset ---


def test_an_included_preset_means_what_is_written_in_it(tmp_path):
    settings_of(tmp_path, "{name: clean}, {sweep: {perturb: [fog], severities: [3]}}", "other.yaml")
    found = settings_of(tmp_path, "{include: other.yaml}, {name: mine, perturb: [{snow: {severity: 1}}]}")
    assert [item.name for item in found] == ["clean", "fog_s3", "mine"]
    preset = read_preset(tmp_path / "p.yaml")
    assert "include" not in str(preset.document)  # the document stands for itself wherever it is recorded
    written = (
        "{name: clean}, {sweep: {perturb: [fog], severities: [3]}}, {name: mine, perturb: [{snow: {severity: 1}}]}"
    )
    settings_of(tmp_path, written, "written.yaml")
    assert preset.sha256 == read_preset(tmp_path / "written.yaml").sha256


def test_an_include_is_relative_to_the_preset_that_includes(tmp_path):
    (tmp_path / "a").mkdir()
    settings_of(tmp_path, "{name: one}", "a/one.yaml")
    settings_of(tmp_path, "{include: one.yaml}, {name: two}", "a/two.yaml")
    assert [item.name for item in settings_of(tmp_path, "{include: a/two.yaml}")] == ["one", "two"]


@cases(
    ("other", "settings", "words"),
    [
        ("{name: one}", "{include: otter.yaml}", ("otter.yaml: ", "presets there: other.yaml")),
        ("{name: one}", "{include: other.yaml, name: b}", ("p.yaml: settings.0: ", "has name beside include")),
        ("{name: one}", "{include: other.yaml}, {name: one}", ("p.yaml: settings.1.name: ", "'one'")),
        ("{name: one}", "{include: other.yaml}, {name: b, perturb: [fig: {}]}", "p.yaml: settings.1.perturb"),
        ("{include: p.yaml}", "{include: other.yaml}", ("other.yaml: settings.0.include: ", "p.yaml includes itself")),
        ("{name: a, perturb: [{fog: {severity: 9}}]}", "{name: b}, {include: other.yaml}",
         ("other.yaml: settings.0.perturb.0.fog.severity: ", "is 9")),
        ("{name: a, pertrub: []}", "{name: b}, {include: other.yaml}", ("other.yaml: settings.0.pertrub: ", "unknown")),
    ],
)  # fmt: skip
def test_includes_that_are_refused_name_the_file_that_is_wrong(tmp_path, other, settings, words):
    (tmp_path / "other.yaml").write_text(HEAD + f"settings: [{other}]\n")
    refused(settings_of, tmp_path, settings, names=words)


def test_a_preset_without_settings_has_none_to_take(tmp_path):
    (tmp_path / "other.yaml").write_text(HEAD)
    refused(
        settings_of,
        tmp_path,
        "{include: other.yaml}",
        names=("settings.0.include: ", "other.yaml has no settings to take"),
    )


def test_overrides_count_the_entries_of_the_file(tmp_path):
    settings_of(tmp_path, "{name: one}, {name: two}", "other.yaml")
    settings_of(tmp_path, "{include: other.yaml}, {name: mine}")
    preset = read_preset(tmp_path / "p.yaml", ["settings.1.name=yours"])
    assert [item.name for item in preset.spec.settings] == ["one", "two", "yours"]


# --- streams ---


def test_a_sweep_names_streams_as_it_names_settings(tmp_path):
    sweep = "{perturb: [fog, snow], severities: [1, 2], modes: [static, dynamic], stream: '{perturb}-{mode}'}"
    found = settings_of(tmp_path, f"{{sweep: {sweep}}}, {{name: fog-static, stream: fog-static, perturb: [{{fog: }}]}}")
    assert [item.stream for item in found[:4]] == ["fog-static", "fog-dynamic"] * 2
    assert {item.steps[0].stream for item in found[4:8]} == {"snow-static", "snow-dynamic"}
    assert found[8].stream == found[8].name
    assert found[8].steps[0].stream is None, "its own name is no other stream"


def test_motion_and_pairing_keep_the_settings_own_name(tmp_path):
    text = (
        "{name: a, stream: b, perturb: [{motion_deviation: {}}, {fog: {}}, {depth_gaussian_noise: {}}, {desync: {}}]}"
    )
    (found,) = settings_of(tmp_path, text)
    assert [step.stream for step in found.steps] == [None, "b", "b", None]


@cases(
    ("text", "words"),
    [
        (
            "{name: a, stream: b}",
            ("settings.0.stream: ", "clean"),
        ),
        (
            "{name: a, stream: b, perturb: [{faster_motion: {factor: 2}}]}",
            ("0.stream: goes ", "not with faster_motion"),
        ),
        ("{name: a, stream: '', perturb: [{fog: {}}]}", ("settings.0.stream: ", "''")),
        ("{name: a, stream: 3, perturb: [{fog: {}}]}", "settings.0.stream: is the number 3"),
        (
            "{stream: b, sweep: {perturb: [fog]}}",
            ("settings.0.stream: ", "goes with name", "into the sweep"),
        ),
        ("{sweep: {perturb: [fog], stream: '{perturbe}'}}", ("sweep.stream: ", "did you mean 'perturb'")),
        (
            "{sweep: {perturb: [desync], parameters: {offset: [5]}, name: x, stream: b}}",
            ("settings.0.sweep.stream: ", "not with desync"),
        ),
    ],
)
def test_streams_that_name_nothing_are_refused(tmp_path, text, words):
    refused(settings_of, tmp_path, text, names=words)
