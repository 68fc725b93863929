"""The small problem of the campaign tests."""

from evaluations import OUTPUTS

from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = StudyProblem(THREE, OUTPUTS, 30, 6, 0)
