"""The command line `tbm-monitor`."""

import os

# Before numpy is loaded: the matrices are small, and several BLAS threads would only fight the other processes of a
# study or of the running nodes for the cores. What the environment says already stays.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
