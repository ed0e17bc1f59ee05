# SPDX-License-Identifier: GPL-3.0-or-later
"""Files cut anywhere, with bits flipped, or of mere noise."""

import random
import warnings

import numpy as np
import pytest
from cases import cases
from ply_files import BINARY, ENCODINGS, MIXED, POINTS, QUADS, XYZ, ply, vertex

from noisy_world.core.errors import InputError


class TestDamage:
    """Whatever happened to a file, it is read or refused: no other exception, and no warning."""

    @staticmethod
    def sample(encoding, faces):
        declarations = (*XYZ, "double quality", *("float red", "float green", "float blue"), "list uchar short tags")
        rows = [(*p, 0.5, 0.25, 0.5, 0.75, (1,) * (i % 2)) for i, p in enumerate(POINTS)]
        edge = ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)])
        faces = ("face", ("int object_id", "list uchar int vertex_indices"), [(3, f) for f in faces])
        return ply(encoding, vertex(declarations, rows), edge, faces)

    @cases("encoding", ENCODINGS)
    def test_every_truncation_of_the_header_is_refused(self, refuse, encoding):
        data = self.sample(encoding, MIXED)
        for size in range(data.index(b"end_header\n") + 11):
            refuse(data[:size])

    @pytest.mark.one_python
    @cases("faces", [QUADS, MIXED])
    @cases("encoding", ENCODINGS)
    def test_every_truncation_of_the_data_is_refused(self, refuse, encoding, faces):
        data = self.sample(encoding, faces)
        # a text file that lost the end of its very last number is a whole file to any reader
        whole = len(data.rstrip()[: -len(data.split()[-1])]) if encoding == "ascii" else len(data)
        # up to their faces the two are alike
        begin = data.index(b"end_header\n") + 11 if faces is MIXED else len(self.sample(encoding, []))
        for size in range(begin, whole):
            refuse(data[:size])

    def test_random_truncations_of_a_larger_file(self, refuse):
        dice = random.Random(6)
        faces = [tuple(dice.randrange(6) for _ in range(dice.choice((3, 4, 5)))) for _ in range(5000)]
        for encoding in BINARY:
            data = self.sample(encoding, faces)
            for _ in range(30):
                refuse(data[: dice.randrange(len(data))])

    @pytest.mark.one_python
    @cases("faces", [QUADS, MIXED])
    @cases("encoding", ENCODINGS)
    def test_flipped_bytes(self, read, encoding, faces):
        dice = random.Random(f"{encoding} {len(faces)}")
        data = self.sample(encoding, faces)
        begin = data.index(b"end_header\n") + 11
        outcomes = set()
        for round_number in range(150):
            damaged = bytearray(data)
            for _ in range(dice.choice((1, 1, 2, 8))):
                at = dice.randrange(begin if round_number % 3 else 0, len(data))
                damaged[at] = dice.randrange(256) if round_number % 2 else damaged[at] ^ (1 << dice.randrange(8))
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    mesh = read(bytes(damaged))
                except InputError as error:
                    assert "\n" not in str(error)  # noqa: PT017
                    outcomes.add("refused")
                    continue
            outcomes.add("read")
            assert np.isfinite(mesh.vertices_m).all()
            assert mesh.rgb is None or (mesh.rgb.min() >= 0 and mesh.rgb.max() <= 1)
            assert mesh.corner_vertices.min() >= 0
            assert mesh.corner_vertices.max() < len(mesh.vertices_m)
            assert mesh.face_sizes.min() >= 3
        assert outcomes == {"read", "refused"}

    @cases("encoding", ENCODINGS)
    def test_noise_after_a_good_header(self, refuse, encoding):
        dice = random.Random(8)
        header = self.sample(encoding, MIXED).split(b"end_header\n")[0] + b"end_header\n"
        for size in (1, 10, 100, 1000, 10000):
            for _ in range(20):
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    refuse(header + dice.randbytes(size))
