"""Numbers and statements of the paper that results are held against: the one place that quotes them.

"Surrogate-Based Multisource Sensitivity Analysis of TBM Driving System" (2018). One file a theme; Table 4 is
`tbm_gsa.sensitivity.study.inputs.PAPER_INPUTS`, since a study needs it as inputs.
"""

from tbm_gsa.paper.loads import TABLE_1, LoadRow

__all__ = ["TABLE_1", "LoadRow"]
