"""run.py MODULE: runs the tests of a module of this folder; 77 (skipped) without NumPy."""

import sys
import unittest
from pathlib import Path

try:
    import numpy  # noqa: F401
except ImportError:
    print("skipped: NumPy is missing (Debian: python3-numpy)")
    sys.exit(77)

sys.path.insert(0, str(Path(__file__).parent))
unittest.main(module=sys.argv[1], argv=[sys.argv[0], *sys.argv[2:]], verbosity=2)
