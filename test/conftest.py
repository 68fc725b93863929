"""What every test may rely on."""

import os
import signal
import tempfile

# One BLAS thread, as the command line and its processes have it: sums over more threads differ in their last bit.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# What a test compares does not go into the history of whoever runs it.
_data = tempfile.TemporaryDirectory(prefix="tbm_test_data_")
os.environ["XDG_DATA_HOME"] = _data.name
os.environ.pop("TBM_HISTORY", None)

# A job in the background of a script inherits an ignored SIGINT, and so would every process that a test starts and
# interrupts. The ones under test are to behave as at a terminal.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
