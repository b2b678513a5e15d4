"""`mrf`: Markov random field: quadratic data term, smoothness that stops at the edges of an intensity image.

    E(X) = Σ_u w_u (x_u − m_u)² + λ Σ_{u,v} g_uv (x_u − x_v)²,     g_uv = exp(−c ‖I_u − I_v‖²)

over neighbours u, v along rows and columns, w and m the number and mean of the samples that fall on a fused
pixel: one sparse symmetric linear system. λ is a pure number, the weight of a link against that of a sample.
I is the guide (a photograph registered to the view), or the fused amplitude; without either, all links are
equal.

Source: Diebel, Thrun, "An Application of Markov Random Fields to Range Sensing", NIPS 2005.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.optimisation.fill import nearest
from solver.optimisation.sampling import Samples, sample
from solver.optimisation.stencil import conjugate_gradients
from solver.preparation.prepare import prepare
from solver.preparation.problem import Problem, Solution
from solver.result import Progress

Image = NDArray[np.float32]

EDGE = 0.02  # of the guide's range: a step at which a link has exp(−½) of its weight; c = 1 / (2 · EDGE²)
GUIDED, PLAIN = (4.0, 1000.0), (0.02, 60.0)
"""λ of `auto` = a + b · (σ / the scene's range)²: links that stop at edges may be stiff, others would blur
them. The square is a Gaussian prior's, the constants are set by trial; the optimum is flat."""

LEAST_LINK = 1e-3  # of the weight of a full one, so that no pixel hangs in the air


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Solve the linear system by conjugate gradients, to `tolerance` / 100 of the right side."""
    used = np.isfinite(problem.distance)
    samples = sample(problem.distance, used.astype(np.float32), problem.positions, problem.options.upsampling)
    seen = samples.weight > 0
    given = problem.options.regularization
    guide, amplitude = _guide(problem)
    strength = _automatic(problem, guide is not None) if given == "auto" else float(given)
    stencil = _stencil(samples.weight, guide, strength)
    middle = np.float32(np.median(samples.mean[seen]))
    first = nearest(np.where(seen, samples.mean - middle, 0).astype(np.float32), seen)
    if initial is not None:
        known = np.isfinite(initial.distance)
        first = np.where(known, initial.distance - middle, first).astype(np.float32)
    right = samples.weight * np.where(seen, samples.mean - middle, 0).astype(np.float32)
    limit = problem.options.max_iterations
    image, steps = conjugate_gradients(
        stencil, right, first, steps=limit, tolerance=problem.options.tolerance / 100
    )
    value = _objective(image, samples, right, stencil, middle)
    if progress is not None:
        progress(steps, value, None)
    return Solution(image + middle, amplitude, strength, steps, value, None, steps < limit)


def _automatic(problem: Problem, guided: bool) -> float:
    least, growth = GUIDED if guided else PLAIN
    extent = problem.spread
    share = problem.usual_deviation / extent if extent > 0 else 0.0
    return least + growth * min(share, 1.0) ** 2


def _guide(problem: Problem) -> tuple[Image | None, Image | None]:
    """The guide on [0, 1], and the fused amplitude where it was made."""
    if problem.guide is not None:
        return _normalised(problem.guide), None
    if problem.amplitude is None:
        return None, None
    amplitude = _fused_amplitude(problem)
    return _normalised(amplitude), amplitude


def _fused_amplitude(problem: Problem) -> Image:
    """The amplitude images fused like distances, each pixel's footprint undone (`area`)."""
    from solver.methods import load

    light = problem.amplitude
    assert light is not None
    options = replace(problem.options, method="area", regularization="auto")
    return load("area")(prepare(light, None, problem.positions, options=options)).distance


def _normalised(image: Image) -> Image:
    finite = np.isfinite(image)
    if not finite.any():
        return np.zeros_like(image)
    low, high = np.percentile(image[finite], (1, 99))
    extent = float(high - low)
    flat = np.where(finite, image, low)
    return np.asarray((flat - low) / extent if extent > 0 else np.zeros_like(image), np.float32)


def _stencil(weight: Image, guide: Image | None, strength: float) -> Image:
    stencil = np.zeros((3, *weight.shape), np.float32)
    across, down = _links(guide, weight.shape, 1), _links(guide, weight.shape, 0)
    across, down = across * np.float32(strength), down * np.float32(strength)
    stencil[0] = weight
    stencil[0, :, :-1] += across
    stencil[0, :, 1:] += across
    stencil[0, :-1] += down
    stencil[0, 1:] += down
    stencil[1, :, :-1] = -across
    stencil[2, :-1] = -down
    return stencil


def _links(guide: Image | None, shape: tuple[int, ...], axis: int) -> Image:
    if guide is None:
        return np.ones([size - (number == axis) for number, size in enumerate(shape)], np.float32)
    step = np.diff(guide, axis=axis) / np.float32(EDGE)
    return np.maximum(np.exp(-0.5 * step * step), LEAST_LINK).astype(np.float32)


def _objective(image: Image, samples: Samples, right: Image, stencil: Image, middle: np.float32) -> float:
    """xᵀ S x − 2 bᵀ x + Σ w m² + the part that no map changes, in float64."""
    x = image.astype(np.float64)
    S = stencil.astype(np.float64)
    square = float((S[0] * x * x).sum() + 2 * (S[1, :, :-1] * x[:, :-1] * x[:, 1:]).sum())
    square += 2 * float((S[2, :-1] * x[:-1] * x[1:]).sum())
    offset = np.where(samples.weight > 0, samples.mean - middle, 0).astype(np.float64)
    constant = float((samples.weight * offset**2).sum()) + samples.constant
    return max(0.0, square - 2 * float((right * x).sum()) + constant)
