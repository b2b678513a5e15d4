"""The paper's experiments on any known depth map."""

from solver.evaluation.metrics import Errors, errors, percent_of_longest_side
from solver.evaluation.objects import procedural_object
from solver.evaluation.protocol import LITERAL, MATCHED, DepthMap, Trial, make_trial

__all__ = [
    "LITERAL",
    "MATCHED",
    "DepthMap",
    "Errors",
    "Trial",
    "errors",
    "make_trial",
    "percent_of_longest_side",
    "procedural_object",
]
