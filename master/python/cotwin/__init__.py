"""Cotwin: digital twins of robot manipulators.

    Robot        kinematics and dynamics of a robot on NumPy arrays
    Simulation   a run of a scenario: set, step, read, run
    Scenario     a scenario that is built in Python and saved as SSD
    Unit         base class of a co-simulation unit in Python, for prototypes
    Recording    recorded signals as NumPy arrays and pandas frames
    tune         a robot's dynamics from measured torques
    excite       a motion for such measurements
    ask          what a motion costs, and which one is better

SI units of measure everywhere: m, kg, s, rad, N, N.m. All errors of the library are cotwin.Error, with place, fact and
expectation; UnknownName is also a KeyError, BadValue a ValueError, MissingFile a FileNotFoundError. docs/python.md has more.
"""

from ._native import (
    BadValue,
    Error,
    ExcitingMotion,
    Figure,
    Joint,
    MissingFile,
    Robot,
    RunResult,
    TunedParameter,
    TuneResult,
    UnknownName,
    Variable,
    version,
)
from .recording import Recording
from .scenario import Scenario
from .services import ask, service_names, service_schema
from .simulation import Result, Simulation, run
from .tuning import excite, tune
from .unit import Unit

__version__ = version()

__all__ = [
    "BadValue",
    "Error",
    "ExcitingMotion",
    "Figure",
    "Joint",
    "MissingFile",
    "Recording",
    "Result",
    "Robot",
    "RunResult",
    "Scenario",
    "Simulation",
    "TuneResult",
    "TunedParameter",
    "Unit",
    "UnknownName",
    "Variable",
    "ask",
    "excite",
    "run",
    "service_names",
    "service_schema",
    "tune",
    "version",
]
