"""Runs of scenarios."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Iterable, Mapping

import numpy as np

from . import _native
from ._native import BadValue
from .recording import Recording
from .scenario import Scenario, text_of
from .unit import Units, table_of


def _assignments(given: Mapping[str, Any] | Iterable[str] | None) -> list[str]:
    if given is None:
        return []
    if isinstance(given, str):
        raise BadValue(f"set: '{given}', expected a dictionary or a list of texts")
    if isinstance(given, Mapping):
        return [f"{name}={text_of(name, value)}" for name, value in given.items()]
    return [str(one) for one in given]


class Simulation(_native.Simulation):
    """A run of a scenario: set, step, read, run.

        twin = cotwin.Simulation("twin.ssd", set={"drive.friction": "lugre"}, stop=2)
        while twin.step():
            twin["drive.tau_e"] = contact_torques
            log(twin.time, twin["drive.tau_J"])

    scenario  an .ssd or .ssp file, or a Scenario
    set       changes of the scenario as `cotwin run --set` takes them, {"drive.K": 2e4} or ["drive.K=2e4"]
    stop      stop time instead of the scenario's, s
    results   folder for signals.csv; None: no file is written. The files of an earlier run there move to its subfolder earlier-1,
              earlier-2 …, as `cotwin run` does it
    units     units in Python: classes derived from cotwin.Unit, or {"name": callable that makes one}
    modules   shared libraries with further units, as `cotwin run --units` takes them
    folders   where robots and scenes are looked up before the default folders
    threads   at most so many; results do not depend on them
    keep      whether recorded rows are kept in memory, for recording()

    Equal scenarios and equal values set at equal times give equal bits, those of `cotwin run`. One thread at a time uses a
    Simulation; another use is an Error. A Simulation cannot be used in a process that was forked after it was made
    (multiprocessing: start method "spawn", or make it in the child). Steps release the GIL; Ctrl-C ends run() and run_to()
    after the present step.
    """

    def __init__(
        self,
        scenario: str | os.PathLike[str] | Scenario,
        *,
        set: Mapping[str, Any] | Iterable[str] | None = None,
        stop: float | None = None,
        results: str | os.PathLike[str] | None = None,
        units: Units | None = None,
        modules: Iterable[str | os.PathLike[str]] = (),
        folders: Iterable[str | os.PathLike[str]] = (),
        threads: int | None = None,
        keep: bool = True,
    ):
        built = isinstance(scenario, Scenario)
        table = table_of(units)
        if built:
            given = {name for name, _, _ in table}
            table += [row for row in table_of(scenario.units) if row[0] not in given]
        super().__init__(
            file=None if built else Path(scenario),
            xml=scenario.to_ssd() if built else None,
            name=scenario.name if built else "",
            folder=Path(scenario.folder) if built else Path(),
            set=_assignments(set),
            stop=None if stop is None else float(stop),
            results=None if results is None else Path(results),
            modules=[Path(one) for one in modules],
            folders=[Path(one) for one in folders],
            threads=threads,
            units=table,
            keep_rows=keep,
        )

    def __getitem__(self, name: str) -> np.ndarray:
        """The same as get(name)."""
        return self.get(name)

    def __setitem__(self, name: str, value: Any) -> None:
        """The same as set(name, value)."""
        self.set(name, value)

    def run(self) -> Result:
        """Steps to the end of the run and closes the recording. Ctrl-C ends it after the present step: the recording has the
        rows so far, and KeyboardInterrupt is raised."""
        try:
            self._run()
        except BaseException:
            self.finish()
            raise
        return Result(self)

    def recording(self) -> Recording:
        """The rows so far: the variables that the scenario records, or all outputs, as in signals.csv. Needs keep=True."""
        table = self._recording()
        return Recording(table.names, table.values, units=table.units, joints=table.joints)

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()


class Result:
    """What a run was like: the figures of RunResult, and the recording."""

    def __init__(self, simulation: Simulation):
        self._simulation = simulation
        self._run = simulation.result()
        self._recording: Recording | None = None

    @property
    def run(self) -> _native.RunResult:
        """Times, ticks, figures and warnings."""
        return self._run

    @property
    def figures(self) -> dict[str, _native.Figure]:
        """What the scenario reports, by name."""
        return {figure.name: figure for figure in self._run.figures}

    @property
    def warnings(self) -> list[str]:
        """Sentences, each once."""
        return self._run.warnings

    @property
    def reached(self) -> float:
        """Time at which the run ended, s."""
        return self._run.reached

    @property
    def recording(self) -> Recording:
        """The recorded signals."""
        if self._recording is None:
            self._recording = self._simulation.recording()
        return self._recording

    def __getitem__(self, signal: str) -> np.ndarray:
        """A recorded signal, as recording[signal]."""
        return self.recording[signal]

    def __repr__(self) -> str:
        return repr(self._run)


def run(scenario: str | os.PathLike[str] | Scenario, **options: Any) -> Result:
    """Runs a scenario to its end. Options as for Simulation."""
    return Simulation(scenario, **options).run()
