"""Ties along edges: what is tied, what is not, and that iteration and certificate know of it."""

import numpy as np
import pytest

from solver import FusionOptions, fuse
from solver.evaluation.protocol import DepthMap, make_trial
from solver.geometry.positions import sample_positions
from solver.kernels import tying as kernels
from solver.kernels.group import PAD
from solver.methods import area
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.memory_gradient import minimise
from solver.optimisation.prior import Prior
from solver.optimisation.term import start
from solver.optimisation.ties import Tied, Ties
from solver.options import NEIGHBOURHOOD, Footprint

SHIFTS = np.array([[0, 0], [0.3, 0.45], [-0.4, 0.2], [0.15, -0.35]])


def padded(image: np.ndarray) -> np.ndarray:
    return np.pad(image, [(0, 0), (PAD, PAD), (PAD, PAD)])


def along_edges(x: np.ndarray, prior: Prior | None = None) -> Ties:
    """All freed, strength 1, δ 1, no slope."""
    flat = np.zeros((len(x), 2, *x.shape[1:]), x.dtype)
    return Ties.along_edges(x, flat, prior or Prior(), np.ones_like(x[0]), 1.0, 1.0)


def random_ties(shape: tuple[int, ...]) -> Ties:
    """Some of every kind on a map of (C, rows, columns)."""
    rng = np.random.default_rng(3)
    x = padded(rng.normal(size=shape))
    ties = along_edges(x)
    levels = (ties.levels * rng.uniform(0, 1, ties.levels.shape)).astype(np.uint8)
    return Ties(levels, 2 * ties.unit, padded(rng.normal(size=(2, *shape[1:])))[None])


def strengths(ties: Ties) -> np.ndarray:
    """(6, rows + 4, columns + 4)."""
    return ties.levels * ties.unit[:, None, None]


def tied_by_hand(x: np.ndarray, ties: Ties) -> float:
    """½ Σ t (G x − s)², offset by offset, of one padded channel."""
    rows, columns = x.shape[0] - 2 * PAD, x.shape[1] - 2 * PAD
    total = 0.0
    for strength, (down, right) in zip(strengths(ties), NEIGHBOURHOOD, strict=True):
        for i in range(PAD, PAD + rows):
            for j in range(PAD, PAD + columns):
                if i + down < PAD + rows and PAD <= j + right < PAD + columns:
                    rise = down * ties.slope[0, 0, i, j] + right * ties.slope[0, 1, i, j]
                    total += 0.5 * strength[i, j] * (x[i, j] - x[i + down, j + right] + rise) ** 2
    return total


def test_an_edge_is_tied_along_itself_and_not_across() -> None:
    step = np.zeros((1, 30, 40))
    step[:, :, 20:] = 50.0
    right, down, *_, right2, down2 = strengths(along_edges(padded(step)))[:, PAD + 15]
    edge = PAD + 19  # the last column before the step
    assert right[edge] < 1e-4
    assert right2[edge - 1] < 1e-4
    assert down[edge] == pytest.approx(1)
    assert down2[edge] == pytest.approx(0.25)
    assert right[edge - 8] == pytest.approx(1)


def test_nothing_is_tied_beyond_the_image_nor_by_offsets_not_chosen() -> None:
    prior = Prior(((0, 1), (1, 0), (1, -1)))
    strength = strengths(along_edges(padded(np.zeros((1, 9, 11))), prior))
    assert not strength[[2, 4, 5]].any()
    for tie, (down, right) in zip(strength, NEIGHBOURHOOD, strict=True):
        i, j = np.nonzero(tie)
        assert ((i >= PAD) & (i + down < 9 + PAD)).all()
        assert ((j + min(right, 0) >= PAD) & (j + max(right, 0) < 11 + PAD)).all()


def test_the_tied_term_is_the_squares_it_says() -> None:
    rng = np.random.default_rng(4)
    positions = sample_positions((4, 4, 5), shifts=SHIFTS)
    term = AreaTerm(rng.normal(size=(1, 4, 4, 5)), np.ones((4, 4, 5)), positions, 2, Footprint())
    ties = random_ties(term.shape)
    tied, x = Tied(term, ties), padded(rng.normal(size=term.shape))
    assert tied.value(x) == pytest.approx(term.value(x) + tied_by_hand(x[0], ties))

    slope, further, step = np.zeros_like(x), np.zeros_like(x), padded(rng.normal(size=term.shape))
    tied.gradient(x, slope)
    tied.gradient(x + step, further)
    product = further - slope
    ahead, behind = tied.value(x + step), tied.value(x - step)
    assert (slope * step).sum() == pytest.approx((ahead - behind) / 2)
    assert (product * step).sum() == pytest.approx(ahead + behind - 2 * tied.value(x))


def test_the_diagonal_is_that_of_the_operator() -> None:
    ties = random_ties((1, 6, 7))
    for i, j in ((PAD, PAD), (PAD + 2, PAD + 3), (PAD + 5, PAD + 6)):
        one = np.zeros((10, 11))
        one[i, j] = 1
        level = Ties(ties.levels, ties.unit, np.zeros_like(ties.slope))
        diagonal = np.zeros_like(one)
        kernels.add_diagonal(0, 1, ties.levels, ties.unit, diagonal)
        assert diagonal[i, j] == pytest.approx(2 * tied_by_hand(one, level))


def test_the_gap_closes_with_ties_too() -> None:
    rng = np.random.default_rng(5)
    positions = sample_positions((4, 6, 7), shifts=SHIFTS)
    values = rng.normal(size=(1, 4, 6, 7)) + 3.0 * np.arange(7)
    term = AreaTerm(values, np.ones((4, 6, 7)), positions, 2, Footprint())
    ties = random_ties(term.shape)
    state = start(np.zeros(term.shape))
    state.slope = ties.slope
    state.radius[...] = rng.uniform(0.5, 2.0, state.radius.shape)
    outcome = minimise(Tied(term, ties), Prior(), state, tolerance=1e-13, limit=3000, rounding=1e-5)
    assert outcome.gap < 1e-4


@pytest.mark.parametrize("variance", [4.1, 46.3])
def test_ties_mend_thin_parts(variance: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slanted bars little wider than a fused pixel: everything is edge, and weights alone free it all."""
    side = np.arange(320)
    across = (side - 0.15 * side[:, None] + 64) % 64
    trial = make_trial(DepthMap(np.where(across < 9, 60.0, 182.0), rescale=False), variance=variance, seed=1)

    def error() -> float:
        options = FusionOptions(method="area")
        fused = fuse(trial.distance, shifts=trial.shifts, options=options).distance
        return float(np.mean((fused - trial.truth) ** 2))

    tied = error()
    monkeypatch.setattr(area, "_TIE", 1e9)
    assert tied < 0.6 * error()
