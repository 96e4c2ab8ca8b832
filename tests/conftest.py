"""What all tests share: the helpers beside this file can be imported from any test."""

import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

# a job in the background of a shell ignores Ctrl-C, and so would the tests of what Ctrl-C does
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
