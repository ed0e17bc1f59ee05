"""Texts from outside are texts in the report: nothing of them is an element, a script, a command or a formula."""

import csv
import html.parser
import json
import re
import xml.etree.ElementTree as ET

import pytest
from chromium import READY, browser, find_chromium
from results_made import SETTINGS, make_results, without_analyses

pytest.importorskip("jinja2", reason="the extra evaluate is not installed")
pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from noisy_world.evaluate.cases import cell_of, text_of
from noisy_world.evaluate.report import write_report
from noisy_world.evaluate.report_tables import FOLDER, latex, markdown
from noisy_world.evaluate.study_tables import csv_text

FIELDS = (
    *("scene", "setting", "perturbation", "system", "mode", "outcome", "failure", "version", "version name"),
    *("digest", "render", "seeds", "protocol", "preset_sha256", "versions", "step", "severity", "state", "indicator"),
)
"""Every text of a results folder that is not this program's own: names, what systems say, what others wrote."""

FOLDERS = ("scene", "setting", "system")
"""Fields that name folders, whose texts are printable: tables with others are refused."""


def marked(field, lead="="):
    """Return a text that each of the report's formats would take for something else; it may be a folder's name."""
    name = field.replace(" ", "_")
    element = "\"'><img src=x onerror=alert(1)><script>alert(1)"
    told = f"{lead}{name}X{element}\n\n# M\n    $(touch x)`x`\\input{{x}}|[l](javascript:x)"
    return " ".join(told.split()) if field in FOLDERS else told


class Page(html.parser.HTMLParser):
    """Elements with their attributes, and the texts in scripts, styles and elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.within, self.attributes, self.comments = [], [], [], []
        self.texts = {"script": "", "style": "", "": ""}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attributes]
        if tag in ("script", "style"):
            self.within.append(tag)

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            assert self.within.pop() == tag

    def handle_data(self, data):
        self.texts[self.within[-1] if self.within else ""] += data

    def handle_comment(self, data):
        self.comments.append(data)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A results folder whose every text is hostile, with its report."""
    folder = tmp_path_factory.mktemp("hostile") / "results"
    noise = (marked("setting"), marked("perturbation"), "static", 5, {})
    with pytest.MonkeyPatch.context() as patch:
        without_analyses(patch)
        plain = {"systems": ("orb_slam3",), "scenes": (marked("scene"),), "settings": (SETTINGS[0], noise)}
        make_results(folder, **plain, seeds=("1",))
        for path in folder.glob("runs/*/*/*/orb_slam3"):
            path.rename(path.with_name(marked("system")))
        for path in folder.rglob("run.json"):
            record = json.loads(path.read_text())
            record["versions"] = {marked("version name"): marked("version")}
            path.write_text(json.dumps(record))
        for path in folder.rglob("errors.csv"):
            path.write_text(path.read_text().replace("lost", f'"{marked("state").replace(chr(34), chr(34) * 2)}"'))
        study = json.loads((folder / "study.json").read_text())
        study["study"] |= {"systems": {marked("system"): marked("digest")}}
        study["study"]["subject"] |= {
            "preset_sha256": marked("preset_sha256"),
            "render": {"engine": marked("render")},
            "versions": {"x": marked("versions")},
        }
        study["study"]["subject"]["settings"][marked("setting")]["steps"][0]["name"] = marked("step")
        (folder / "study.json").write_text(json.dumps(study))
        for name in ("runs", "sequences"):
            path = folder / "tables" / f"{name}.csv"
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
            for row in rows:
                if name == "runs":
                    row |= {"system": marked("system"), "failure": marked("failure"), "outcome": marked("outcome")}
                else:
                    row[marked("indicator")] = "1.0"
                row["mode"] = marked("mode") if row["mode"] else ""
            path.write_text(csv_text(rows, list(rows[0])))
        written = write_report(folder)
    return folder, list(written.files)


def test_the_page_holds_texts_alone(hostile):
    folder, _ = hostile
    page = Page((folder / "report.html").read_text())
    data, script = page.texts["script"].split("\n", 1)
    assert re.fullmatch(r"[A-Za-z0-9+/]+=*", data)
    assert script.strip() == (FOLDER / "report.js").read_text().strip()
    assert page.texts["style"].strip() == (FOLDER / "report.css").read_text().strip()
    assert (page.elements.count("script"), page.elements.count("style"), page.comments) == (2, 1, [])
    assert not {"iframe", "object", "embed", "base", "link", "svg"} & set(page.elements)
    assert page.elements.count("form") == 1
    for tag, name, value in page.attributes:
        assert not name.startswith("on"), (tag, name, value)
        if name in ("src", "href", "action", "formaction", "srcdoc", "style", "http-equiv"):
            harmless = r"#[\w-]+|data:image/jpeg;base64,[A-Za-z0-9+/]+=*|background: #[0-9a-f]{6}"
            assert re.fullmatch(harmless, value), (tag, name, value)
    told = page.texts[""] + "".join(value for _, _, value in page.attributes)
    shown = {field for field in FIELDS if f"{field.replace(' ', '_')}X" in told}
    assert shown >= {
        "scene",
        "setting",
        "perturbation",
        "system",
        "mode",
        "version",
        "version name",
        "digest",
        "render",
    }
    assert shown >= {"versions", "preset_sha256", "failure"}
    assert "<img src=x onerror=alert(1)>" in told  # as a text


def test_the_script_makes_texts_of_them(hostile):
    if find_chromium() is None:
        pytest.skip("needs chromium")
    folder, _ = hostile
    with browser() as tab:
        tab.open((folder / "report.html").as_uri())
        tab.run(READY)
        tab.run("document.querySelector('#grid button:not(:disabled)').click()")
        tab.run("document.querySelectorAll('.compared').forEach((box) => box.click())")
        tab.run("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        assert tab.run("document.querySelectorAll('img[src=x], dialog script, table script').length") == 0
        assert "onerror=alert(1)" in tab.run("document.getElementById('run').textContent")
        assert tab.complaints() == []


def test_pictures_hold_texts_alone(hostile):
    pictures = [path for path in hostile[1] if path.suffix == ".svg"]
    assert len(pictures) >= 3
    for path in pictures:
        for element in ET.fromstring(path.read_text()).iter():
            tag = element.tag.rpartition("}")[2]
            assert tag not in ("script", "foreignObject", "a", "animate", "set", "handler"), path.name
            for name, value in element.attrib.items():
                assert not name.lower().startswith("on"), path.name
                if name.endswith("href"):
                    assert re.match(r"#|data:image/png;base64,", value.strip()), path.name


def test_markdown_holds_texts_alone(hostile):
    folder, _ = hostile
    lines = (folder / "report.md").read_text().splitlines()
    assert "# M" not in lines
    assert not [line for line in lines if line.strip().startswith("$(")]
    for line in lines:
        if line.startswith("    "):
            assert line.startswith("    noisy-world evaluate PRESET --systems '=systemX")
            continue
        plain = re.sub(r"\\.", "", line)
        assert not re.search(r"<|`", plain.replace("\\", "")), line
        assert re.fullmatch(r"(!\[[^]]*\]\(figures/[a-z0-9_-]+\.(svg|jpg)\))|[^\[\]]*", plain), line


def test_latex_holds_texts_alone(hostile):
    tables = [path.read_text() for path in hostile[1] if path.suffix == ".tex"]
    assert any("systemX" in text for text in tables)
    for text in tables:
        assert "\\input" not in text
        assert "\\textbackslash{}input" in text or "systemX" not in text
        for line in text.splitlines():
            assert not line.startswith(("[", "*"))
    assert latex("[5pt] x") == "{}[5pt] x"
    assert markdown("a\n# b") == "a\\\\n\\# b"


def test_tables_hold_no_formula(hostile):
    folder, files = hostile
    read = 0
    for path in [*(path for path in files if path.suffix == ".csv"), *sorted((folder / "tables").glob("*.csv"))]:
        with path.open(newline="") as file:
            for row in csv.reader(file):
                for cell in row:
                    read += "X" in cell
                    assert not re.match(r"[=+@\t\r]|-(?![0-9.]|inf|nan)", cell), (path.name, cell)
    assert read > 10


@pytest.mark.parametrize("text", ["=1", "+1", "-1", "@x", "\tx", "'=1", "''-x", "'x", "x=1", "", "'"])
def test_a_text_comes_back_from_its_cell(text):
    assert text_of(cell_of(text)) == text
    assert not cell_of(text).startswith(("=", "+", "-", "@", "\t"))
