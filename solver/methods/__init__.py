"""The fusion methods: one module each, found by name in one table and imported on use."""

from importlib import import_module
from typing import Protocol

from solver.preparation.problem import Problem, Solution
from solver.result import Progress

METHODS: dict[str, str] = {
    "nearest": "solver.methods.nearest",
    "bicubic": "solver.methods.bicubic",
    "shift-and-add": "solver.methods.shift_and_add",
    "ibsr": "solver.methods.ibsr",
    "mrf": "solver.methods.mrf",
    "lidarboost": "solver.methods.lidarboost",
    "area": "solver.methods.area",
    "phasor": "solver.methods.phasor",
}
"""Module by method name; each has a function `solve` of type `Solve`."""


class Solve(Protocol):
    """Fuses registered frames; `initial` is a map to start from, such as the previous one of a stream."""

    def __call__(
        self, problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None
    ) -> Solution: ...


def load(name: str) -> Solve:
    """The solve function of a method in the table."""
    solve: Solve = import_module(METHODS[name]).solve
    return solve
