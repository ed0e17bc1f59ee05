"""The vocabulary of ORB-SLAM3: DBoW2's text format, read here by its description."""

import numpy as np
import pytest

from noisy_world.evaluate.system_installation import vocabulary_text

PICTURES = 6


@pytest.fixture(scope="module")
def pictures():
    """Noisy copies of 40 descriptors, of which picture k shows those from k on."""
    random = np.random.default_rng(3)
    words = random.integers(0, 2, (40, 256), dtype=np.uint8)
    flips = random.random((PICTURES, 40, 256)) < 0.02
    return [(words ^ flips[k])[k:].astype(np.uint8) for k in range(PICTURES)]


def nodes(text):
    lines = text.split("\n")
    rows = [line.split() for line in lines[1:]]
    bits = np.unpackbits(np.array([row[2:34] for row in rows], dtype=np.uint8), axis=1)
    return (
        lines[0],
        [int(row[0]) for row in rows],
        [row[1] == "1" for row in rows],
        bits,
        [float(row[34]) for row in rows],
    )


def test_the_text_is_a_tree_of_dbow2(pictures):
    header, parents, words, bits, weights = nodes(vocabulary_text(pictures))
    assert header == "10 6 0 0"
    assert all(parent < number for number, parent in enumerate(parents, 1))
    inner = {number for number, word in enumerate(words, 1) if not word} | {0}
    assert set(parents) == inner
    assert max(parents.count(parent) for parent in inner) <= 10
    assert bits.shape == (len(parents), 256)
    assert all(weight == 0.0 for weight, word in zip(weights, words, strict=True) if not word)


def test_equal_features_of_several_pictures_are_one_word(pictures):
    _, parents, words, bits, weights = nodes(vocabulary_text(pictures))

    def word_of(descriptor):
        at = 0
        while at == 0 or not words[at - 1]:
            children = [number for number, parent in enumerate(parents, 1) if parent == at]
            at = min(children, key=lambda number: int((bits[number - 1] != descriptor).sum()))
        return at

    found = [[word_of(bits_) for bits_ in picture] for picture in pictures]
    same = [found[k][j - k] == found[0][j] for k in range(1, PICTURES) for j in range(k, 40)]
    assert np.mean(same) > 0.95
    shown_by = {word: sum(word in picture for picture in found) for picture in found for word in picture}
    for word, count in shown_by.items():
        assert weights[word - 1] == pytest.approx(np.log(PICTURES / count), abs=0.2)


def test_the_same_pictures_give_the_same_text(pictures):
    assert vocabulary_text(pictures) == vocabulary_text(pictures)
