"""Started by a test and killed by it: a slow campaign in the folder given, goes on with the one that is there."""

import sys
from pathlib import Path

if __name__ == "__main__":
    # Imported here, because worker processes import this module too and need none of it.
    from campaign_problem import PROBLEM
    from evaluations import Traced

    from tbm_gsa.study.campaign import run_campaign
    from tbm_gsa.study.store import Store

    folder = Path(sys.argv[1])
    with Store.create_or_open(folder / "store.sqlite", PROBLEM) as store:
        run_campaign(store, Traced(str(folder / "calls"), seconds=0.1), workers=2)
