# SPDX-License-Identifier: GPL-3.0-or-later
"""Checkpoints read without torch: recorded, written by hand as the format says, damaged, and malicious ones."""

import io
import pickle
import zipfile

import numpy as np
import pytest
from recorded_checkpoints import CO_SLAM, NICE_SLAM, pose_of

from noisy_world.core.errors import InputError, NotFiniteError
from noisy_world.evaluation.systems.readers import read_estimate
from noisy_world.evaluation.systems.readers.torch_files import Tensor, open_torch

STAMPS_S = [0.05 * k for k in range(6)]
INDEX = {"frames": [{"index": k, "stamp_s": STAMPS_S[k], "colour": f"{k}.png", "depth": None} for k in range(6)]}


@pytest.fixture
def nice_slam(tmp_path):
    (tmp_path / "ckpts").mkdir()
    (tmp_path / "ckpts/00004.tar").write_bytes(NICE_SLAM)
    return tmp_path / "ckpts/00004.tar"


@pytest.fixture
def co_slam(tmp_path):
    (tmp_path / "checkpoint5.pt").write_bytes(CO_SLAM)
    return tmp_path / "checkpoint5.pt"


# --- recorded ---


def test_nice_slam(nice_slam):
    for path in (nice_slam, nice_slam.parent):
        found = read_estimate("nice_slam", path, INDEX)
        assert found.stamps_s.tolist() == STAMPS_S[:5]  # frame 5 is not estimated
        assert np.allclose(found.c2w, [pose_of(k) for k in range(5)], atol=1e-6)
    (nice_slam.parent / "00003.tar").write_bytes(b"an older one")
    assert len(read_estimate("nice_slam", nice_slam.parent, INDEX)) == 5


@pytest.mark.parametrize("name", ["co_slam", "co_slam_relative"])
def test_co_slam(co_slam, name):
    for path in (co_slam, co_slam.parent):
        found = read_estimate(name, path, INDEX)
        assert found.stamps_s.tolist() == STAMPS_S
        assert np.allclose(found.c2w, [pose_of(k) for k in range(6)], atol=1e-5)


def test_what_a_checkpoint_holds_beside_poses(nice_slam, co_slam):
    with open_torch(nice_slam) as held:
        assert sorted(held) == [
            "c", "decoder_state_dict", "estimate_c2w_list", "gt_c2w_list", "idx", "keyframe_list", "selected_keyframes",
        ]  # fmt: skip
        assert held["idx"].array() == 4
        assert held["c"]["grid_middle"].array().shape == (1, 2, 1, 1, 1)
        assert np.array_equal(held["gt_c2w_list"].array()[:5], [np.eye(4)] * 5)
    with open_torch(co_slam) as held:
        assert held["model"]["half.weight"].array().dtype == np.float16
        assert held["model"]["weight"].array().shape == (1, 2)


def test_no_folder_of_checkpoints(tmp_path):
    for name, words in (("nice_slam", "00000.tar and so on"), ("co_slam", "checkpoint0.pt and so on")):
        with pytest.raises(InputError, match=f"holds no checkpoint: {words}"):
            read_estimate(name, tmp_path, INDEX)


# --- written by hand: the opcodes of pickle's protocol 2, and the archive around them ---

FLOAT = b"ctorch\nFloatStorage\n"


def text(word):
    data = word.encode()
    return b"X" + len(data).to_bytes(4, "little") + data


def whole(number):
    return b"J" + number.to_bytes(4, "little", signed=True)


def tensor(key, shape, strides, count, *, offset=0, storage=FLOAT):
    """torch._utils._rebuild_tensor_v2(storage, offset, shape, strides, False, OrderedDict())."""
    pid = b"(" + text("storage") + storage + text(key) + text("cpu") + whole(count) + b"tQ"
    axes = [b"(" + b"".join(map(whole, numbers)) + b"t" for numbers in (shape, strides)]
    hooks = b"ccollections\nOrderedDict\n)R"
    return b"ctorch._utils\n_rebuild_tensor_v2\n(" + pid + whole(offset) + axes[0] + axes[1] + b"\x89" + hooks + b"tR"


def mapping(**items):
    return b"\x80\x02}(" + b"".join(text(name) + value for name, value in items.items()) + b"u."


def archive(data, storages, *, order=None, compression=zipfile.ZIP_STORED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as file:
        file.writestr("archive/data.pkl", data)
        for key, numbers in storages.items():
            file.writestr(f"archive/data/{key}", numbers)
        if order:
            file.writestr("archive/byteorder", order)
        file.writestr("archive/version", "3\n")
    return stream.getvalue()


def legacy(data, storages, machine=None):
    head = [
        0x1950A86A20F9469CFC6C,
        1001,
        machine or {"protocol_version": 1001, "little_endian": True, "type_sizes": {}},
    ]
    parts = [pickle.dumps(value, 2) for value in head]
    parts += [data, pickle.dumps(list(storages), 2)]
    parts += [len(numbers).to_bytes(8, "little") + numbers.tobytes() for numbers in storages.values()]
    return b"".join(parts)


NUMBERS = np.arange(12, dtype="<f4")


def read(tmp_path, data, name="a"):
    (tmp_path / "file.pt").write_bytes(data)
    with open_torch(tmp_path / "file.pt") as held:
        return held[name].array()


@pytest.mark.parametrize("way", ["zip", "legacy"])
def test_shapes_strides_and_offsets(tmp_path, way):
    def made(part):
        return archive(part, {"0": NUMBERS.tobytes()}) if way == "zip" else legacy(part, {"0": NUMBERS})

    assert np.array_equal(read(tmp_path, made(mapping(a=tensor("0", (3, 4), (4, 1), 12)))), NUMBERS.reshape(3, 4))
    assert np.array_equal(read(tmp_path, made(mapping(a=tensor("0", (4, 3), (1, 4), 12)))), NUMBERS.reshape(3, 4).T)
    assert np.array_equal(read(tmp_path, made(mapping(a=tensor("0", (2, 2), (4, 1), 12, offset=5)))), [[5, 6], [9, 10]])
    assert read(tmp_path, made(mapping(a=tensor("0", (), (), 12, offset=11)))) == 11
    assert read(tmp_path, made(mapping(a=tensor("0", (0, 4), (4, 1), 12)))).shape == (0, 4)
    for shape, strides, offset in (((3, 4), (4, 1), 1), ((13,), (1,), 0), ((2,), (-1,), 5), ((1,), (1,), -1)):
        with pytest.raises(InputError, match="a tensor reaches beyond its numbers"):
            read(tmp_path, made(mapping(a=tensor("0", shape, strides, 12, offset=offset))))


def test_tensors_that_are_more_than_their_numbers(tmp_path):
    """Steps of 0 make any array of a few numbers; axes of no length, of none."""

    def made(shape, strides):
        return archive(mapping(a=tensor("0", shape, strides, 12)), {"0": NUMBERS.tobytes()})

    huge = 2**31 - 1
    with pytest.raises(InputError, match=r"holds poses of 8590 MB, more than the 64 MB of limits.estimate_mb"):
        read(tmp_path, made((huge, 1), (0, 1)))
    with pytest.raises(InputError, match=r"is damaged: a tensor of 3 axes"):
        read(tmp_path, made((0, huge, huge, huge)[:3], (0, 0, 0)))
    with pytest.raises(InputError, match=r"is damaged: a tensor of 99 axes"):
        read(tmp_path, made((1,) * 99, (0,) * 99))
    (tmp_path / "file.pt").write_bytes(made((12,), (1,)))
    with (
        pytest.raises(InputError, match=r"holds poses of 0 MB, more than"),
        open_torch(tmp_path / "file.pt", 40) as held,
    ):
        held["a"].array()


def test_big_endian_and_other_kinds(tmp_path):
    data = mapping(a=tensor("0", (12,), (1,), 12))
    assert np.array_equal(read(tmp_path, archive(data, {"0": NUMBERS.astype(">f4").tobytes()}, order="big")), NUMBERS)
    whole_numbers = mapping(a=tensor("7", (2,), (1,), 2, storage=b"ctorch\nLongStorage\n"))
    assert read(tmp_path, archive(whole_numbers, {"7": np.array([1, -2], "<i8").tobytes()})).tolist() == [1, -2]
    cuda = mapping(a=tensor("0", (12,), (1,), 12, storage=b"ctorch.cuda\nFloatStorage\n"))
    assert np.array_equal(read(tmp_path, legacy(cuda, {"0": NUMBERS})), NUMBERS)
    brain = mapping(a=tensor("0", (2,), (1,), 2, storage=b"ctorch\nBFloat16Storage\n"))
    with pytest.raises(InputError, match="holds a tensor of bfloat16"):
        read(tmp_path, archive(brain, {"0": bytes(4)}))


@pytest.mark.parametrize("way", ["zip", "legacy"])
@pytest.mark.parametrize(
    ("part", "words"),
    [
        (b"cos\nsystem\n" + b"(" + text("touch ran") + b"tR", "holds 'os.system'; a checkpoint holds tensors"),
        (b"cbuiltins\neval\n" + b"(" + text("1") + b"tR", "holds 'builtins.eval'"),
        (b"cnumpy\nfromfile\n)R", "holds 'numpy.fromfile'"),
        (b"ctorch\nload\n)R", "holds 'torch.load'"),
        (b"ctorch._utils\n_rebuild_tensor_v2.__globals__\n)R", "holds 'torch._utils._rebuild_tensor_v2.__globals__'"),
        (b"ctorch\nFloatStorage\n(tR", "is no checkpoint of torch, or a damaged one"),
        (text("module") + b"Q", "is no checkpoint of torch, or a damaged one"),
    ],
)
def test_nothing_is_called_that_a_file_names(tmp_path, way, part, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = mapping(a=part)
    (tmp_path / "file.pt").write_bytes(archive(data, {}) if way == "zip" else legacy(data, {}))
    with pytest.raises(InputError) as error, open_torch(tmp_path / "file.pt"):
        pass
    assert words in str(error.value)
    assert not (tmp_path / "ran").exists()


def test_what_is_of_no_use_is_passed_over(tmp_path):
    scalar = (
        b"cnumpy._core.multiarray\nscalar\n(cnumpy\ndtype\n(" + text("f8") + b"\x89\x88tR" + text("12345678") + b"tR"
    )
    kind = b"ctorch\nfloat32\n"
    data = mapping(x=scalar, y=kind, a=tensor("0", (12,), (1,), 12))
    assert np.array_equal(read(tmp_path, archive(data, {"0": NUMBERS.tobytes()})), NUMBERS)


@pytest.mark.parametrize("recorded", [NICE_SLAM, CO_SLAM], ids=["legacy", "zip"])
def test_damaged_files_are_refused_or_read(tmp_path, recorded):
    rng = np.random.default_rng(5)
    path, told = tmp_path / "file.tar", []
    for case in range(400):
        data = bytearray(recorded)
        if case % 2:
            del data[int(rng.integers(len(data))) :]
        else:
            for place in rng.integers(len(data), size=int(rng.integers(1, 4))):
                data[place] = int(rng.integers(256))
        path.write_bytes(data)
        try:
            with open_torch(path) as held:
                values = held.values() if isinstance(held, dict) else []
                for value in values:
                    if isinstance(value, Tensor) and np.prod(value.shape) < 1e6:
                        value.array()
        except InputError as error:
            told.append(str(error))
    assert len(told) > 100
    assert all(line.startswith(str(path)) for line in told)


def test_a_pickle_that_asks_for_much_memory(tmp_path):
    long = b"\x8a\x10" + bytes(15) + b"\x01"  # a number of 120 bits: many of one hash could be made
    for part in (
        long,
        b"]" * 3_000_001,
        b"r\xff\xff\xff\x7f0",
        b"\x96\x00\x00\x00\x00\x10\x00\x00\x00",
        b"\x8a\x7f",
        b"X\xff\xff\xff\x7fa",
    ):
        for data in (archive(b"\x80\x02N" + part + b"N.", {}), legacy(b"\x80\x02N" + part + b"N.", {})):
            (tmp_path / "file.pt").write_bytes(data)
            with (
                pytest.raises(InputError, match="is no checkpoint of torch, or a damaged one"),
                open_torch(tmp_path / "file.pt"),
            ):
                pass


def test_damage_that_is_named(tmp_path):
    data = mapping(a=tensor("0", (12,), (1,), 12))
    with pytest.raises(InputError, match="is damaged: the numbers '0' are not as many as it says"):
        read(tmp_path, archive(data, {"0": NUMBERS.tobytes()[:-4]}))
    with pytest.raises(InputError, match="is damaged: the numbers '0' cannot be read"):
        read(tmp_path, archive(data, {}))
    with pytest.raises(InputError, match="is damaged: the numbers '0' cannot be read"):
        read(tmp_path, archive(data, {"0": NUMBERS.tobytes()}, compression=zipfile.ZIP_DEFLATED))
    with pytest.raises(InputError, match="is damaged: it ends too early"):
        read(tmp_path, legacy(data, {"0": NUMBERS})[: -48 - 4])
    with pytest.raises(InputError, match="is damaged: it does not list its numbers"):
        read(tmp_path, legacy(data, {"1": NUMBERS}))
    with pytest.raises(InputError, match="is a zip archive, but no checkpoint of torch"):
        read(tmp_path, archive(data, {}).replace(b"data.pkl", b"deta.pkl"))
    with pytest.raises(InputError, match="of a machine that is not little-endian"):
        read(tmp_path, legacy(data, {"0": NUMBERS}, machine={"little_endian": False}))


# --- checkpoints without what the readers look for ---


def test_checkpoints_of_something_else(tmp_path):
    poses = tensor("0", (1, 4, 4), (16, 4, 1), 16)
    eye = {"0": np.eye(4, dtype="<f4").tobytes()}
    cases = [
        ("nice_slam", mapping(a=poses), "holds no poses: estimate_c2w_list"),
        ("nice_slam", b"\x80\x02].", "holds no poses: estimate_c2w_list"),
        ("nice_slam", mapping(estimate_c2w_list=poses), "says no frame of its 1 as the last: idx"),
        ("nice_slam", mapping(estimate_c2w_list=poses, idx=whole(1)), "says no frame of its 1 as the last: idx"),
        ("co_slam", mapping(pose=poses), "holds no poses by number: pose"),
        ("co_slam", mapping(pose=b"}" + whole(0) + poses + b"s"), "pose, frame 0: is no pose of 4 x 4"),
        ("co_slam_relative", mapping(pose=b"}"), "holds no poses by number: pose_rel"),
    ]
    for name, data, words in cases:
        (tmp_path / "file.pt").write_bytes(archive(data, eye))
        with pytest.raises(InputError) as error:
            read_estimate(name, tmp_path / "file.pt", INDEX)
        assert words in str(error.value), name
    (tmp_path / "file.pt").write_bytes(archive(mapping(estimate_c2w_list=poses, idx=whole(0)), eye))
    found = read_estimate("nice_slam", tmp_path / "file.pt", INDEX)
    assert np.array_equal(found.c2w, [np.diag([1.0, -1, -1, 1])])


def test_a_checkpoint_of_no_numbers(tmp_path):
    wild = np.full((4, 4), np.nan, "<f4")
    data = mapping(estimate_c2w_list=tensor("0", (1, 4, 4), (16, 4, 1), 16), idx=whole(0))
    (tmp_path / "00000.tar").write_bytes(legacy(data, {"0": wild.ravel()}))
    with pytest.raises(NotFiniteError, match="frame 0: its pose is not finite"):
        read_estimate("nice_slam", tmp_path, INDEX)
