# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames as a map-style dataset: as PyTorch's DataLoader takes it, with workers that are forked or spawned."""

import contextlib
import io
import multiprocessing
import pickle
import re
import runpy
import sys
import types
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from refusals import refused
from forked import in_new_process
from recipes_made import COUNT, make
from worlds import ROOT

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
    refused(lambda: listed[26], names=("26 frames", "26 is none"), error=IndexError)
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


def embree_frames(made):
    """A list of frames whose meshes are loaded, and those frames as this process makes them."""
    listed = noisy_world.open(made.recipe).frames(compressed=False).load()
    return listed, [listed[place] for place in range(len(listed))]


def shared_by_workers(made):
    """What the page's example prints; what two forked workers make of a list, where none of them can load a mesh."""
    import noisy_world.render.ray_session

    printed = run_example(made)
    LOADED.append(embree_frames(made)[0])
    noisy_world.render.ray_session.RaySession = None
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork")) as pool:
        return printed, list(pool.map(fetch, BATCHES, timeout=60))


@pytest.fixture(scope="module")
def cast(tmp_path_factory):
    """A recipe whose clean frames rays give."""
    pytest.importorskip("embreex", reason="embreex is not installed: the extra `embree`")
    settings = [{"name": "clean"}, {"name": "fog", "perturb": [{"fog": {"severity": 3}}]}]
    render = {"engine": "embree", "samples": 1, "backend": "reference"}
    return make(tmp_path_factory.mktemp("cast"), clean=False, settings=settings, frames=4, render=render)


def test_forked_workers_share_the_meshes_that_were_loaded_before(cast):
    (printed, found), (_, listed) = in_new_process(shared_by_workers, cast), embree_frames(cast)
    for places, samples in zip(BATCHES, found, strict=True):
        assert all(same(sample, listed[place]) for place, sample in zip(places, samples, strict=True))
    lines = printed.splitlines()
    assert sum(int(re.match(r"\((\d+), 3, ", line)[1]) for line in lines) == 4, "as many frames"
    assert all(float(re.search(r"([\d.]+)\)?$", line)[1]) > 1 for line in lines), "fog changes colours"


class ForkingLoader:
    """As PyTorch's DataLoader with workers and batches of one."""

    def __init__(self, dataset, *, num_workers, multiprocessing_context, **others):
        LOADED.append(dataset)
        self._how = num_workers, multiprocessing.get_context(multiprocessing_context)

    def __iter__(self):
        workers, context = self._how
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            for samples in pool.map(fetch, [[place] for place in range(len(LOADED[-1]))], timeout=60):
                yield {key: value[None] for key, value in samples[0].items()}


class Tensor(np.ndarray):
    """An array that has what the page's example asks of a tensor."""

    def permute(self, *axes):
        return self.transpose(axes)

    def float(self):
        return self.astype(np.float32)

    def abs(self):
        return np.abs(self)


def run_example(made):
    """Run the page's example, with PyTorch's place taken where it is missing; return what it prints."""
    try:
        import torch
    except ImportError:
        torch = types.ModuleType("torch")
        torch.Tensor, torch.from_numpy = Tensor, lambda array: array.view(Tensor)
        data = types.ModuleType("torch.utils.data")
        data.DataLoader, data.Dataset = ForkingLoader, object
        sys.modules |= {"torch": torch, "torch.utils": types.ModuleType("torch.utils"), "torch.utils.data": data}
    sys.argv = ["torch_dataset.py", str(made.recipe), "fog"]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        runpy.run_path(str(ROOT / "docs/examples/torch_dataset.py"), run_name="__main__")
    return printed.getvalue()


def test_torch_loads_it(made):
    utils = pytest.importorskip("torch.utils.data", reason="torch is not installed")
    listed = listed_frames(made)
    loader = utils.DataLoader(listed, batch_size=2, num_workers=2, shuffle=False)
    seen = [{key: np.asarray(values[row]) for key, values in batch.items()} for batch in loader for row in range(2)]
    assert all(same(one, listed[place]) for place, one in enumerate(seen))
