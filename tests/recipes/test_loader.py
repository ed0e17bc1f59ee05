# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames as a map-style dataset: as PyTorch's DataLoader takes it, with workers that are forked or spawned."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from forked import in_new_process
from recipes_made import COUNT

import noisy_world

WANTED = ["fog_s3", "adrift", "fast", "shaky_mixed"]
FRAMES_OF = {"fog_s3": COUNT, "adrift": COUNT, "fast": 3, "shaky_mixed": 5}
BATCHES = [[0, 5], [7, 2], [4, 6], [1, 3]]


def same(one, other):
    assert one.keys() == other.keys()
    return all(np.array_equal(one[key], other[key]) for key in one)


def test_a_list_of_frames_is_in_order(made):
    opened = noisy_world.open(made.recipe, made.clean)
    listed = opened.frames(WANTED)
    assert len(listed) == sum(FRAMES_OF.values())
    assert [listed.where(place) for place in range(len(listed))] == [
        (f"{name}/box", index) for name in sorted(WANTED) for index in range(FRAMES_OF[name])
    ]
    assert all(same(one, one) for place, one in enumerate(listed))
    assert same(listed[-1], listed[len(listed) - 1])
    assert [item["index"] for item in listed[2:20:6]] == [2, 8, 2]
    with pytest.raises(IndexError, match="the list has 26 frames, counted from 0; 26 is none of them"):
        listed[26]
    part = opened.frames("f*", frames=slice(1, 3))
    assert [part.where(place) for place in range(len(part))][:3] == [
        ("fast/box", 1),
        ("fast/box", 2),
        ("fog_dynamic/box", 1),
    ]
    assert len(opened.frames()) == sum(len(sequence) for sequence in opened.values())


def test_a_sample_is_what_the_frame_is(made):
    opened = noisy_world.open(made.recipe, made.clean)
    sample, frame = opened.frames("shaky_mixed")[3], opened["shaky_mixed/box"][3]
    assert np.array_equal(sample["rgb"], frame.rgb)
    assert np.array_equal(sample["depth_m"], frame.depth_m)
    assert np.array_equal(sample["c2w"], frame.c2w)
    assert (sample["sequence"], sample["index"]) == ("shaky_mixed/box", 3)
    raw = opened.frames("shaky_mixed", compressed=False)[3]
    assert np.array_equal(raw["rgb"], frame.rgb_uncompressed)
    assert 0 < np.abs(raw["rgb"].astype(int) - sample["rgb"]).mean() < 3, "JPEG's loss alone"
    assert all(value.flags.writeable for value in sample.values() if isinstance(value, np.ndarray))


LOADED = []


def load(dataset):
    """Begin a worker as DataLoader does: the dataset comes pickled, once."""
    LOADED.append(pickle.loads(dataset))


def fetch(places):
    return [LOADED[-1][place] for place in places]


def listed_frames(made):
    return noisy_world.open(made.recipe, made.clean).frames(["fog_s3", "shaky_mixed"], frames=slice(0, 4))


def fetched(made, method, workers):
    context = multiprocessing.get_context(method)
    given = pickle.dumps(listed_frames(made))
    with ProcessPoolExecutor(workers, mp_context=context, initializer=load, initargs=(given,)) as pool:
        return list(pool.map(fetch, BATCHES))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_give_the_same_as_in_order(made, method):
    found = in_new_process(fetched, made, "fork", 2) if method == "fork" else fetched(made, "spawn", 1)
    listed = listed_frames(made)
    for places, samples in zip(BATCHES, found, strict=True):
        assert all(same(sample, listed[place]) for place, sample in zip(places, samples, strict=True))


def test_torch_loads_it(made):
    utils = pytest.importorskip("torch.utils.data", reason="torch is not installed")
    listed = listed_frames(made)
    loader = utils.DataLoader(listed, batch_size=2, num_workers=2, shuffle=False)
    seen = [{key: np.asarray(values[row]) for key, values in batch.items()} for batch in loader for row in range(2)]
    assert all(same(one, listed[place]) for place, one in enumerate(seen))
