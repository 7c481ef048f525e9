"""Co-simulation units in Python, for prototypes."""

from __future__ import annotations

import math
import pickle
import re
from typing import Any, Callable, Iterable, Mapping, NamedTuple, Union

import numpy as np

from ._native import BadValue, Error
from .masks import refuse_mask


class _Declared(NamedTuple):
    role: str
    name: str
    storage: np.ndarray  # read and written by the master
    visible: np.ndarray  # the unit's attribute
    si: str
    description: str
    min: float
    max: float


_WRITABLE = ("output", "state")


class Unit:
    """Base class of a unit of a scenario, `unit:NAME`.

        class Spring(cotwin.Unit):
            "A mass on a spring."                      # the summary

            def declare(self):
                self.parameter("k", si="N/m", start=100, min=0)
                self.input("f", si="N", description="force on the mass")
                self.state("x", si="m", start=0.1)
                self.state("v", si="m/s")
                self.output("position", si="m")

            def initialise(self, t):
                self.position = self.x

            def step(self, t, h):                      # from t to t + h, s
                self.v += h * (self.f - self.k * self.x)
                self.x += h * self.v
                self.position = self.x

    Every variable is a vector of float64, here of one element, and an attribute: an array on the memory that the master
    reads and writes. Assignments to an attribute write into that array. Inputs and parameters are read-only for the unit.

    name        of the unit in sources; by default the class's name in snake case
    restorable  whether a step can be taken back. Attributes that are no variables are then saved with pickle. Set it to
                False if step() changes something else: a file, a socket, a device
    """

    name: str | None = None
    restorable: bool = True

    def __new__(cls, *args: Any, **kwargs: Any) -> Unit:
        self = super().__new__(cls)
        object.__setattr__(self, "_variables", {})
        return self

    # To be written by the user.

    def declare(self) -> None:
        """Names the variables: input(), output(), parameter(), tunable(), state()."""
        raise NotImplementedError(f"{type(self).__name__} has no declare()")

    def initialise(self, t: float) -> None:
        """Makes outputs and states agree with parameters and inputs at the start time t, s. May be called repeatedly."""

    def step(self, t: float, h: float) -> bool | None:
        """Steps from t to t + h, s. Returns False if the run shall end after this step."""
        raise NotImplementedError(f"{type(self).__name__} has no step()")

    # Declarations.

    def input(self, name: str, size: int = 1, **options: Any) -> np.ndarray:
        """Written by others before a step. Returns a read-only array (size,). options:

        si           unit of measure, SI: "N.m"; "1" (default) for a pure number
        description  a sentence
        start        start values: a number or `size` numbers; 0 by default
        min, max     bounds; the master refuses start values beyond them
        """
        return self._add("input", name, size, **options)

    def output(self, name: str, size: int = 1, **options: Any) -> np.ndarray:
        """Holds at t + h after a step. Arguments as for input()."""
        return self._add("output", name, size, **options)

    def parameter(self, name: str, size: int = 1, **options: Any) -> np.ndarray:
        """Given by the scenario, fixed from initialise() on. Arguments as for input()."""
        return self._add("parameter", name, size, **options)

    def tunable(self, name: str, size: int = 1, **options: Any) -> np.ndarray:
        """A parameter that may change between two steps. Arguments as for input()."""
        return self._add("tunable", name, size, **options)

    def state(self, name: str, size: int = 1, **options: Any) -> np.ndarray:
        """What a step remembers. Arguments as for input()."""
        return self._add("state", name, size, **options)

    def _add(
        self,
        role: str,
        name: str,
        size: int,
        *,
        si: str = "1",
        description: str = "",
        start: Any = 0.0,
        min: float = -math.inf,
        max: float = math.inf,
    ) -> np.ndarray:
        place = f"{type(self).__name__}.{name}"
        if not isinstance(size, (int, np.integer)) or isinstance(size, bool) or size < 1:
            raise BadValue(f"{place}: size {size!r}, expected a whole number of at least 1")
        if not name.isidentifier():
            raise BadValue(f"{place}: expected a name of letters, digits and '_'")
        if name in self._variables:
            raise Error(f"{place}: declared twice")
        if hasattr(type(self), name):
            raise Error(f"{place}: is the name of an attribute of the class, expected another one")
        refuse_mask(place, start)
        storage = np.empty(size)
        try:
            storage[...] = np.asarray(start, dtype=float)
        except (TypeError, ValueError) as error:
            raise BadValue(f"{place}: start {start!r}, expected one number or {size}") from error
        visible = storage.view()
        visible.flags.writeable = role in _WRITABLE
        text = description or name.replace("_", " ")
        self._variables[name] = _Declared(role, name, storage, visible, si, text, float(min), float(max))
        self.__dict__[name] = visible
        return visible

    def __setattr__(self, name: str, value: Any) -> None:
        variable = self._variables.get(name)
        if variable is None:
            object.__setattr__(self, name, value)
        elif value is variable.visible:  # self.x += …
            return
        elif variable.role in _WRITABLE:
            refuse_mask(f"{type(self).__name__}.{name}", value)
            array = np.asarray(value, dtype=float)
            if array.shape not in ((), variable.storage.shape):
                raise BadValue(
                    f"{type(self).__name__}.{name}: a value of shape {array.shape}, expected {variable.storage.shape} or a number"
                )
            variable.storage[...] = array
        else:
            article = "an" if variable.role == "input" else "a"
            raise Error(f"{type(self).__name__}.{name}: is {article} {variable.role}, which the unit only reads")

    def __delattr__(self, name: str) -> None:
        if name in self._variables:
            raise Error(f"{type(self).__name__}.{name}: is a variable, which cannot be deleted")
        object.__delattr__(self, name)

    # Used by the module.

    def _declared(self) -> list[_Declared]:
        self._variables.clear()
        self.declare()
        return list(self._variables.values())

    def _own(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_variables" and k not in self._variables}

    def _save(self) -> bytes:
        own = self._own()
        if not own:
            return b""
        try:
            return pickle.dumps(own, protocol=5)
        except Exception as error:
            raise Error(
                f"{type(self).__name__}: its attributes ({', '.join(own)}) cannot be saved with pickle, expected such ones or "
                f"restorable = False"
            ) from error

    def _restore(self, data: bytes) -> None:
        for name in self._own():
            del self.__dict__[name]
        if data:
            self.__dict__.update(pickle.loads(data))


def name_of(cls: type) -> str:
    """The name of a class's unit in sources."""
    given = getattr(cls, "name", None)
    if isinstance(given, str):
        return given
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z0-9])(?=[A-Z][a-z])", "_", cls.__name__).lower()


Units = Union[Mapping[str, Callable[[], Unit]], Iterable[type]]


def table_of(units: Units | None) -> list[tuple[str, str, Callable[[], Unit]]]:
    """Name, summary and callable of each unit."""
    if units is None:
        return []
    if isinstance(units, Mapping):
        pairs = list(units.items())
    else:
        pairs = []
        for one in units:
            if not isinstance(one, type) or not issubclass(one, Unit):
                raise BadValue(f"units: {one!r}, expected classes derived from cotwin.Unit, or names with what makes them")
            pairs.append((name_of(one), one))
    table = []
    for name, make in pairs:
        if not callable(make):
            raise BadValue(f"units: {name} is {make!r}, expected a class derived from cotwin.Unit or a function that makes a unit")
        summary = (getattr(make, "__doc__", None) or "a unit in Python").strip().splitlines()[0]
        table.append((str(name), summary, make))
    return table
