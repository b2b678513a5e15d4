"""The paper's experiments on any known depth map."""

from solver.evaluation.experiment import Lambda, Outcome, Setting, compare, run_method
from solver.evaluation.metrics import Errors, errors, percent_of_longest_side
from solver.evaluation.objects import procedural_object
from solver.evaluation.protocol import LITERAL, MATCHED, DepthMap, Region, Trial, make_trial

__all__ = [
    "LITERAL",
    "MATCHED",
    "DepthMap",
    "Errors",
    "Lambda",
    "Outcome",
    "Region",
    "Setting",
    "Trial",
    "compare",
    "errors",
    "make_trial",
    "percent_of_longest_side",
    "procedural_object",
    "run_method",
]
