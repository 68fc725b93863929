"""Started by a test and killed by it: a campaign in the folder given, which goes on with the one that is there.

Its simulations after as many as the second argument says are held, see `Held`.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    # Imported here, because worker processes import this module too and need none of it.
    from campaign_problem import PROBLEM
    from evaluations import Held

    from tbm_gsa.sensitivity.study.campaign import run_campaign
    from tbm_gsa.sensitivity.study.store import Store

    folder, free = sys.argv[1:]
    with Store.create_or_open(Path(folder) / "store.sqlite", PROBLEM) as store:
        run_campaign(store, Held(folder, int(free)), workers=2)
