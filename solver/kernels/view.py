"""Rows of images as kernels walk them, at the price of one address.

A slice of Numba's checks its bounds, wraps negative indices and counts references, with an atomic addition
each time. A view does none of it, so it must lie within the image's memory, and must not outlive the function
that makes it.
"""

from typing import Any

from numba import types
from numba.core import cgutils, config
from numba.extending import intrinsic


def _view(_, image, row, first, n):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """The n elements from image[(*row, first)] on, one after another in memory; image is C-contiguous.

    Args:
        row: a tuple of the leading indices, none negative.
        first: ≥ 0.
    """
    kind = types.Array(image.dtype, 1, "C")

    def generate(context, builder, _, arguments):  # type: ignore[no-untyped-def]
        source = context.make_array(image)(context, builder, arguments[0])
        indices = [*cgutils.unpack_tuple(builder, arguments[1]), arguments[2]]  # type: ignore[no-untyped-call]
        place = cgutils.get_item_pointer(  # type: ignore[no-untyped-call]
            context, builder, image, source, indices, wraparound=False
        )
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(image.dtype)))
        out = context.make_array(kind)(context, builder)
        context.populate_array(
            out, data=place, shape=[arguments[3]], strides=[size], itemsize=size, meminfo=None
        )
        return out._getvalue()

    if image.layout != "C" or len(row) != image.ndim - 1:
        return None
    return kind(image, row, types.intp, types.intp), generate


def _plain(image, row, first, n):  # type: ignore[no-untyped-def]
    """The same where nothing is compiled."""
    start = first
    for index, stride in zip(row, image.strides, strict=False):
        start += index * stride // image.itemsize
    return image.reshape(-1)[start : start + n]


view: Any = _plain if config.DISABLE_JIT else intrinsic(_view)  # type: ignore[attr-defined]
