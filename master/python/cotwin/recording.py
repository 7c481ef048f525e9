"""Recordings of runs as NumPy arrays and pandas frames."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Iterator

import numpy as np

from . import _native
from ._native import BadValue, Error, UnknownName
from .masks import refuse_mask

if TYPE_CHECKING:
    import pandas

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_ELEMENT = re.compile(r"^(.*)\[(\d+)\]$")


class Recording:
    """Signals over time.

    names   columns of values: "time", "drive.q[1]", "drive.q[2]" …
    values  (rows, columns) float64; time in s, the others in the units of measure of their variables
    cut     whether the file ended within a row, which was left out
    units   units of measure of columns by name, joints: names of their joints; of results beside which there is no run.json: none

        q = recording["drive.q"]       # (rows, n)
        frame = recording.to_pandas()  # needs pandas
    """

    def __init__(self, names: list[str], values: np.ndarray, cut: bool = False, units: list[str] | None = None, joints: list[str] | None = None):
        refuse_mask("recording: values", values)
        values = np.ascontiguousarray(values, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(names):
            raise BadValue(f"recording: values have the shape {values.shape}, expected (rows, {len(names)})")
        self.names = list(names)
        self.values = values
        self.cut = cut
        self.units = {name: unit for name, unit in zip(self.names, units or []) if unit}
        self.joints = {name: joint for name, joint in zip(self.names, joints or []) if joint}
        self._columns: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            self._columns.setdefault(name, []).append(i)
            element = _ELEMENT.match(name)
            if element:
                self._columns.setdefault(element[1], []).append(i)

    @classmethod
    def load(cls, place: str | os.PathLike[str], t_column: str = "", time_unit: str = "s",
             topic: str = "") -> Recording:
        """Reads signals.csv, or that of a folder of results; any other CSV file of numbers with a header and a time, and ROS 2 bags, too.

        t_column   name of the time column, which becomes "time"; "": t, time or timestamp, otherwise an Error
        time_unit  of that column: s, ms, us or ns
        topic      of a bag; "": the only one with joints

        The signals.csv.part of a run that was killed is read where there is no signals.csv. A file that ends within a row
        gives a RuntimeWarning and a recording without that row.
        """
        file = Path(place)
        if file.is_dir() and not (file / "metadata.yaml").exists():
            candidates = [file / "signals.csv", file / "signals.csv.part"]
            file = next((one for one in candidates if one.exists()), candidates[0])
        if time_unit not in _SECONDS:
            raise BadValue(f"time_unit: '{time_unit}', expected one of {', '.join(_SECONDS)}")
        table = _native.load_table(file, t_column, _SECONDS[time_unit], topic)
        if table.cut:
            warnings.warn(f"{file} ends within a row, which is left out", RuntimeWarning, stacklevel=2)
        return cls(table.names, table.values, table.cut, table.units, table.joints)

    @property
    def time(self) -> np.ndarray:
        """(rows,), s."""
        return self["time"]

    @property
    def signals(self) -> list[str]:
        """Names of the recorded variables, "drive.q", without their elements."""
        names = (_ELEMENT.match(name) for name in self.names)
        return list(dict.fromkeys(m[1] if m else name for m, name in zip(names, self.names) if name != "time"))

    def __getitem__(self, name: str) -> np.ndarray:
        """A vector, (rows, n), or a scalar or one element, (rows,): a view of values where the columns are neighbours."""
        columns = self._columns.get(name)
        if columns is None:
            raise UnknownName(f"recording: no column '{name}', expected one of {', '.join(['time', *self.signals])}")
        if self.names[columns[0]] == name:
            return self.values[:, columns[0]]
        first, last = columns[0], columns[-1] + 1
        return self.values[:, first:last] if last - first == len(columns) else self.values[:, columns]

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.values)

    def __repr__(self) -> str:
        return f"<Recording of {len(self)} rows: {', '.join(self.signals)}>"

    def to_pandas(self) -> pandas.DataFrame:
        """A frame with the time in s as index and a column per element; frame.attrs has "units" and "joints" by column."""
        try:
            import pandas
        except ImportError as error:
            raise Error("to_pandas: needs pandas, which is missing (Debian: python3-pandas)") from error
        index = pandas.Index(self.time, name="time") if "time" in self.names else None
        columns = [i for i, name in enumerate(self.names) if name != "time"]
        frame = pandas.DataFrame(self.values[:, columns], index=index, columns=[self.names[i] for i in columns])
        frame.attrs["units"], frame.attrs["joints"] = dict(self.units), dict(self.joints)
        return frame
