"""What all tests share: the helpers beside this file can be imported from any test."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
