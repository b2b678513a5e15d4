"""Elementary functions of float32 that loops can vectorise, and half as long numbers to keep strengths in.

The library's own are called one by one, which takes far longer. Polynomials after Cephes (Moshier,
"Methods and Programs for Mathematical Functions", 1989): to 2 units in the last place.
"""

from typing import Any

import numpy as np
from numba import njit, types
from numba.core import config
from numba.extending import intrinsic


def _cast(kind: Any) -> Any:
    """The bits of a number taken for one of another kind, as long."""
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return lambda value: value.view(np.dtype(str(kind)))

    def cast(_, value):  # type: ignore[no-untyped-def]
        def generate(context, builder, _, arguments):  # type: ignore[no-untyped-def]
            return builder.bitcast(arguments[0], context.get_value_type(kind))

        return kind(value), generate

    return intrinsic(cast)


_as_bits, _as_float = _cast(types.uint32), _cast(types.float32)

_HALF_UNIT, _SIXTEEN = np.uint32(0x8000), np.uint32(16)


@njit
def shorten(value):  # type: ignore[no-untyped-def]
    """The 16 leading bits of a float32, rounded: eight binary digits, the range of a float32."""
    return np.uint16((_as_bits(np.float32(value)) + _HALF_UNIT) >> _SIXTEEN)


@njit
def lengthen(bits):  # type: ignore[no-untyped-def]
    """The float32 that `shorten` has shortened."""
    return _as_float(np.uint32(np.uint32(bits) << _SIXTEEN))


_one, _half = np.float32(1), np.float32(0.5)
_PER_TWO, _TWO_HIGH, _TWO_LOW = np.float32(1 / np.log(2)), np.float32(0.693359375), np.float32(-2.12194440e-4)
_E = tuple(
    np.float32(c)
    for c in (1.9875691500e-4, 1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 1.6666665459e-1, 0.5)
)


@njit(fastmath={"contract"}, error_model="numpy")
def exponential(x):  # type: ignore[no-untyped-def]
    """e^x, for |x| < 80."""
    n = np.rint(x * _PER_TWO)
    f = x - n * _TWO_HIGH
    f = f - n * _TWO_LOW
    y = ((((_E[0] * f + _E[1]) * f + _E[2]) * f + _E[3]) * f + _E[4]) * f + _E[5]
    y = y * f * f + f + _one
    return y * _as_float(np.uint32(np.uint32(np.int32(n) + np.int32(127)) << np.uint32(23)))


_PER_RIGHT = np.float32(2 / np.pi)
_RIGHT = np.float32(1.5703125), np.float32(4.837512969970703125e-4), np.float32(7.5497899548918821e-8)
_S = tuple(np.float32(c) for c in (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1))
_C = tuple(np.float32(c) for c in (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2))


@njit(fastmath={"contract"}, error_model="numpy")
def sine_cosine(x):  # type: ignore[no-untyped-def]
    """(sin x, cos x), for some thousand turns at most."""
    k = np.rint(x * _PER_RIGHT)
    r = x - k * _RIGHT[0]
    r = r - k * _RIGHT[1]
    r = r - k * _RIGHT[2]
    q, s = np.int32(k), r * r
    sine = ((_S[0] * s + _S[1]) * s + _S[2]) * s * r + r
    cosine = ((_C[0] * s + _C[1]) * s + _C[2]) * s * s - _half * s + _one
    odd = (q & np.int32(1)) != 0
    a, b = (cosine if odd else sine), (sine if odd else cosine)
    return (-a if (q & np.int32(2)) != 0 else a), (-b if ((q + np.int32(1)) & np.int32(2)) != 0 else b)


_L = tuple(
    np.float32(c)
    for c in (
        7.0376836292e-2,
        -1.1514610310e-1,
        1.1676998740e-1,
        -1.2420140846e-1,
        1.4249322787e-1,
        -1.6668057665e-1,
        2.0000714765e-1,
        -2.4999993993e-1,
        3.3333331174e-1,
    )
)
_MANTISSA, _BIAS = np.uint32(0x007FFFFF), np.uint32(0x3F000000)
_ROOT = np.float32(np.sqrt(0.5))


@njit(fastmath={"contract"}, error_model="numpy")
def logarithm(x):  # type: ignore[no-untyped-def]
    """ln x, for an ordinary x > 0."""
    bits = _as_bits(x)
    n = np.float32(np.int32(bits >> np.uint32(23)) - np.int32(126))
    m = _as_float(np.uint32((bits & _MANTISSA) | _BIAS))
    low = m < _ROOT
    n, f = (n - _one if low else n), (m + m - _one if low else m - _one)
    s = f * f
    y = ((((_L[0] * f + _L[1]) * f + _L[2]) * f + _L[3]) * f + _L[4]) * f + _L[5]
    y = (((y * f + _L[6]) * f + _L[7]) * f + _L[8]) * f * s
    y = y + n * _TWO_LOW - _half * s
    return f + y + n * _TWO_HIGH
