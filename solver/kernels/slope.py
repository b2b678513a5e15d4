"""What each pixel has to say of the slope around it (see `solver.slope`)."""

from numba import njit


@njit(fastmath=True)
def _add_square(across, along, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] += across[j] * across[j] + along[j] * along[j]


@njit(fastmath=True)
def _subtract(a, b, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = a[j] - b[j]


@njit(fastmath=True, error_model="numpy")
def _weigh(scale, out):  # type: ignore[no-untyped-def]
    """out ← 1 / (1 + scale · out)²."""
    one = out.dtype.type(1)
    for j in range(out.size):
        part = one + scale * out[j]
        out[j] = one / (part * part)


@njit(fastmath=True)
def _scale(by, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] *= by[j]


@njit(nogil=True, cache=True)
def votes(rank, size, x, scale, out):  # type: ignore[no-untyped-def]
    """out (1 + 2 C, rows, columns) ← each pixel's say, and its rise by row and by column times it.

    Args:
        x: (C, rows + 4, columns + 4), padded; the last row and column repeat the rise before them.
        scale: 1 / edge²; the say is 1 / (1 + scale · rises²)².
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        say = out[0, row]
        say[:] = 0
        # In an image of one row or column nothing rises along it.
        i, last = max(0, min(row, rows - 2)), max(n - 1, 1)
        for c in range(channels):
            down, right = out[1 + 2 * c, row], out[2 + 2 * c, row]
            if rows > 1:
                _subtract(x[c, i + 3, 2 : 2 + n], x[c, i + 2, 2 : 2 + n], down)
            else:
                down[:] = 0
            right[:] = 0
            _subtract(x[c, row + 2, 3 : 2 + n], x[c, row + 2, 2 : 1 + n], right[: n - 1])
            right[last:] = right[last - 1]
            _add_square(down, right, say)
        _weigh(scale, say)
        for c in range(channels):
            _scale(say, out[1 + 2 * c, row])
            _scale(say, out[2 + 2 * c, row])
