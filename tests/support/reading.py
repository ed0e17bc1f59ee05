# SPDX-License-Identifier: GPL-3.0-or-later
"""How hard a page is to read: the grade of Flesch and Kincaid (1975), of its prose."""

import re


def prose(page):
    """The sentences of a page of Markdown: without code, tables, pictures, headings and the addresses of links."""
    text = re.sub(r"^---\n.*?^---\n|<!--.*?-->|^```.*?^```", "", page, flags=re.DOTALL | re.MULTILINE)
    blocks = re.split(r"\n\s*\n", text)
    blocks = [block for block in blocks if not re.match(r"\s*(\||#|    |<|!\[|:::|--8)", block)]
    text = "\n\n".join(re.sub(r"^\s*(?:[-*]|\d+\.) +", "\n\n", block, flags=re.MULTILINE) for block in blocks)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "name", text)  # a name of the program's is read as a word
    return re.sub(r"[*_]", "", text)


def sentences(text):
    """The sentences, as lists of words: each ends at a full stop or with its paragraph."""
    parts = re.split(r"(?<=[.!?])\s+|\n\s*\n", text)
    found = [re.findall(r"[A-Za-z][A-Za-z'-]*", part) for part in parts]
    return [words for words in found if len(words) > 1]


def syllables(word):
    """About how many syllables a word has: its groups of vowels, without a silent e at its end."""
    groups = re.findall(r"[aeiouy]+", word.lower())
    silent = re.search(r"[^aeiouyl]e$|[^aeiouytd]ed$", word.lower()) is not None
    return max(1, len(groups) - silent)


def grade(page):
    """The grade of a page's prose: years of school that reading it takes."""
    found = sentences(prose(page))
    words = [word for sentence in found for word in sentence]
    return 0.39 * len(words) / len(found) + 11.8 * sum(map(syllables, words)) / len(words) - 15.59
