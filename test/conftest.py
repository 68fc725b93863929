"""What every test may rely on."""

import signal

# A job in the background of a script inherits an ignored SIGINT, and so would every process that a test starts and
# interrupts. The ones under test are to behave as at a terminal.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
