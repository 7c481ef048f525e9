"""What several test files use."""

import os
import tempfile
import unittest
from pathlib import Path

import numpy as np

import cotwin

SOURCE = Path(os.environ["COTWIN_SOURCE"])
PROGRAM = os.environ["COTWIN_PROGRAM"]

Q0 = np.array([0.0, 0.3, 0.0, -1.2, 0.0, 0.9, 0.0])
Q1 = np.array([0.9, 0.8, 0.5, -0.6, 0.7, 0.2, 1.2])


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def assertError(self, *parts):
        """A context whose body must raise cotwin.Error with all these parts in its message."""
        case = self

        class Context:
            def __enter__(self):
                return self

            def __exit__(self, kind, error, _):
                case.assertIsNotNone(kind, f"no error, expected one with {parts}")
                if not issubclass(kind, cotwin.Error):
                    return False
                self.error = error
                for part in parts:
                    case.assertIn(part, str(error))
                return True

        return Context()


def arm(stop=1.0, **options):
    """An LWR 4+ on its way from Q0 to Q1: motion, compliance, drive train."""
    s = cotwin.Scenario("arm", robot="lwr4", stop=stop, **options)
    s.add("motion", kind="waypoints", points=2, values={"waypoint_t": [0.1, 1.6], "waypoint_q": [Q0, Q1]})
    s.add("compliance")
    s.add("drive", "drive_train", values={"q0": Q0})
    s.connect("motion", "compliance", "q_d dq_d ddq_d")
    s.connect("compliance", "drive", "tau_m")
    s.connect("drive", "compliance", "q dq theta dtheta")
    return s
