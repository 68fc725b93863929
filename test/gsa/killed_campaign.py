"""Started by a test and killed by it: a slow campaign in the folder given, goes on with the one that is there."""

import sys
from pathlib import Path

from evaluations import OUTPUTS, Traced

from tbm_gsa.study.campaign import run_campaign
from tbm_gsa.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.study.problem import Problem
from tbm_gsa.study.store import Store

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = Problem(THREE, OUTPUTS, 30, 6, 0)

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with Store.create_or_open(folder / "store.sqlite", PROBLEM) as store:
        run_campaign(store, Traced(str(folder / "calls"), seconds=0.15), workers=2)
