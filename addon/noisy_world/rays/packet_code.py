# SPDX-License-Identifier: GPL-3.0-or-later
"""What numba lacks for packets of rays: C functions called by address, bytes at addresses, and vectors."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WORD = 4  # bytes


def _called(_typing: Any, address: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        words = cgutils.unpack_tuple(builder, values[1], arguments.count)
        kind = ir.FunctionType(ir.VoidType(), [word.type for word in words])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), words)
        return context.get_dummy_value()

    return types.void(address, arguments), generate


call: Any = intrinsic(_called)
"""Call a C function at an address with a tuple of words of 64 bits."""


def _loaded(_typing: Any, address: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.load(builder.inttoptr(values[0], ir.IntType(8).as_pointer()))

    return types.uint8(address), generate


byte_at: Any = intrinsic(_loaded)
"""Return the byte at an address."""


SLACK = 2.0**-20  # of a length; Embree compares and divides within a few units of 2^-24


def tie_marker(lanes: int) -> Any:
    """Return what marks the rays of a packet that meet two triangles at nearly one length.

    It is given addresses: which rays meet a triangle; at which lengths, which it makes longer by SLACK, so that Embree
    goes on to what is as near; the last lengths, which it replaces; and the marks. In vectors: ray by ray it takes a
    fifth of Embree's own time.
    """
    numbers, masks = ir.VectorType(ir.FloatType(), lanes), ir.VectorType(ir.IntType(32), lanes)

    def mark(_typing: Any, valid: Any, now: Any, last: Any, tied: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            kinds = (masks, numbers, numbers, masks)
            places = [builder.inttoptr(value, kind.as_pointer()) for value, kind in zip(values, kinds, strict=True)]
            meets, lengths, last_lengths, marked = (builder.load(place, align=WORD) for place in places)
            there = builder.icmp_signed("!=", meets, ir.Constant(masks, [0] * lanes))
            slack = builder.fmul(lengths, ir.Constant(numbers, [SLACK] * lanes))
            longer = builder.fadd(lengths, slack)
            near = builder.and_(
                builder.fcmp_ordered("<=", builder.fsub(lengths, slack), last_lengths),
                builder.fcmp_ordered("<=", last_lengths, longer),
            )
            marks = builder.or_(marked, builder.and_(builder.sext(near, masks), meets))
            for place, value in zip(
                places[1:],
                (builder.select(there, longer, lengths), builder.select(there, lengths, last_lengths), marks),
                strict=True,
            ):
                builder.store(value, place, align=WORD)
            return context.get_dummy_value()

        return types.void(valid, now, last, tied), generate

    return intrinsic(mark)
