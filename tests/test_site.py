# SPDX-License-Identifier: GPL-3.0-or-later
"""The docs' site, opened from its folder by a browser: pages are whole, links lead somewhere, search finds."""

from pathlib import Path
from urllib.parse import unquote

import pytest
from chromium import browser, find_chromium
from worlds import ROOT

SITE = ROOT / "out/docs"

pytestmark = [
    pytest.mark.skipif(find_chromium() is None, reason="needs chromium"),
    pytest.mark.skipif(not (SITE / "search/search_index.js").is_file(), reason="needs the site: make docs"),
]

# What a page tells of itself: how much wider it is than the window, where its links lead, and what can be led to.
FACTS = """({
  wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  links: [...document.querySelectorAll("a[href], link[href], img[src], script[src], source[src], video[src]")]
    .map((item) => item.href || item.src),
  names: [...document.querySelectorAll("[id], a[name]")].map((item) => item.id || item.name),
  broken: [...document.images].filter((image) => image.complete && !image.naturalWidth).map((image) => image.src),
  quoted: [...document.querySelectorAll("blockquote")].filter((item) => item.textContent.includes("names(")).length,
})"""

# Typing into the search, by the magnifier where the window is narrow: the titles of what is found.
SEARCHED = """(async () => {
  const magnifier = document.querySelector("label.md-header__button[for=__search]");
  if (magnifier.getBoundingClientRect().width > 0) magnifier.click();
  const field = document.querySelector("[data-md-component=search-query]");
  field.focus();
  field.value = "fog";
  field.dispatchEvent(new Event("input", { bubbles: true }));
  field.dispatchEvent(new KeyboardEvent("keyup", { bubbles: true, key: "g" }));
  const found = () => [...document.querySelectorAll(".md-search-result__item h1")].map((title) => title.textContent);
  for (let tries = 0; tries < 2000 && found().length === 0; tries++) await new Promise((go) => setTimeout(go, 50));
  const shown = document.querySelector(".md-search__output").getBoundingClientRect();
  return shown.width > 100 && shown.height > 100 ? found() : [];
})()"""


@pytest.fixture(scope="module")
def tab():
    with browser() as opened:
        yield opened


WIDTHS_PX = (1400, 400)


def visit(tab):
    """Open every page; yield each with what it tells of itself in a wide and a narrow window, and its complaints."""
    for page in sorted(SITE.rglob("*.html")):
        if page.name == "404.html":
            continue  # a server's, whose links begin at the server's root
        tab.size(WIDTHS_PX[0])
        tab.open(page.as_uri())
        facts = {}
        for width_px in WIDTHS_PX:
            tab.size(width_px)
            facts[width_px] = tab.run(FACTS)  # it also waits for the page's scripts
        yield page, facts, tab.complaints()


def dead_links(told):
    """The links, of all pages, that lead to no file of the site, or to no place of its page."""
    names = {page: {*facts["names"], ""} for page, facts in told.items()}
    for page, facts in told.items():
        for link in facts["links"]:
            address, _, anchor = link.partition("#")
            if not address.startswith("file:"):
                continue  # other sites' links are theirs
            target = Path(unquote(address.partition("?")[0].removeprefix("file://")))
            if not target.is_file() or (target in names and unquote(anchor) not in names[target]):
                yield f"{page.relative_to(SITE)}: {link}"


def test_every_page_is_whole(tab):
    told = {}
    wrong = []
    for page, facts, complaints in visit(tab):
        told[page] = facts[WIDTHS_PX[0]]
        wrong += [f"{page.name}: {text}" for text in [*complaints, *told[page]["broken"]]]
        wrong += [f"{page.name}: overflows {width_px} px" for width_px in WIDTHS_PX if facts[width_px]["wide"] > 0]
        wrong += [f"{page.name}: a doctest is a quotation"] if told[page]["quoted"] else []
    assert len(told) > 20
    wrong += dead_links(told)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("width_px", WIDTHS_PX)
@pytest.mark.parametrize("page", ["index.html", "reference/perturb.html"])
def test_search_finds_fog_without_a_server(tab, page, width_px):
    tab.size(width_px)
    tab.open((SITE / page).as_uri())
    found = tab.run(SEARCHED)
    assert any("Perturbations" in title for title in found), found
    assert tab.complaints() == []


def test_what_is_wrong_would_be_seen(tab, tmp_path):
    page = tmp_path / "page.html"
    page.write_text(
        '<meta charset="utf-8"><title>t</title><p style="width: 900px">a</p><a href="none.html">a</a>'
        '<a href="#none">b</a><img src="none.png"><script>none()</script>'
    )
    tab.size(400)
    tab.open(page.as_uri())
    facts = tab.run(FACTS)
    assert facts["wide"] == 900 + 8 - 400
    assert any("none is not defined" in text for text in tab.complaints())
    assert facts["broken"] == [(tmp_path / "none.png").as_uri()]
    assert {link.rpartition("/")[2] for link in facts["links"]} >= {"none.html", "page.html#none"}
