"""Tuning of a robot to measured torques, and motions for such measurements."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Callable, Iterable

from . import _native
from ._native import BadValue, ExcitingMotion, TuneResult, UnknownName


def _paths(given: Any) -> list[Path]:
    return [Path(given)] if isinstance(given, (str, os.PathLike)) else [Path(one) for one in given]


def _fill(options: Any, given: dict[str, Any]) -> None:
    for name, value in given.items():
        if not hasattr(options, name):
            known = ", ".join(one for one in dir(options) if not one.startswith("_"))
            raise UnknownName(f"option '{name}': unknown, expected one of {known}")
        try:
            setattr(options, name, value)
        except TypeError as error:
            raise BadValue(f"option '{name}': {value!r} is of another type, expected one as {getattr(options, name)!r}") from error


def tune(
    robot: str | os.PathLike[str],
    data: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    held_out: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
    progress: Callable[[str, float], Any] | None = None,
    **options: Any,
) -> TuneResult:
    """Tunes a robot's inertias, friction and motors to measured torques, as `cotwin tune` (docs/tuning.md).

    robot     URDF, or the name of a robot
    data      logs (CSV): t (s), q1…, tau1…, behind the gears, in SI
    out       folder for the results, made if missing; files there are overwritten
    held_out  logs that are only predicted; without, the end of data
    progress  called with a phase and the share of it that is done; it ends the search if it returns False
    options   method="swarm" ("feasible", "least-squares"), friction="sigmoid" ("none", "coulomb", "stribeck"),
              motor_torques=True, cross_validate=False, split=0.7, cutoff=0.0 (Hz; 0: from the motion), prior_weight=None,
              seed=1, rounds=500, threads=1, q_columns="", dq_columns="", tau_columns=""

    Equal data, options and seeds give equal bits. Ctrl-C ends the search; what was found so far is in `out`.
    """
    chosen = _native.TuneOptions()
    _fill(chosen, {"robot": os.fspath(robot), "data": _paths(data), "out": Path(out), "held_out": _paths(held_out), **options})
    return _native.tune(chosen, progress)


def excite(
    robot: str | os.PathLike[str], *, progress: Callable[[int], Any] | None = None, **options: Any
) -> ExcitingMotion:
    """Designs a motion that excites a robot's dynamics, for measurements, as `cotwin excite`.

    robot     URDF, or the name of a robot
    progress  called with the number of each round; the search ends with an Error if it returns False
    options   period=10.0 (s), periods=1, rate=250.0 (Hz), harmonics=5, share=0.9 (of every limit), ddq_max=10.0 (rad/s^2),
              dq_max=None (rad/s), q_min=[], q_max=[] (n, rad or m), criterion="condition" ("determinant"), seed=1, rounds=150,
              particles=40, threads=1

    The motion keeps the limits of the URDF; it is not checked for collisions. Equal options give equal bits.
    """
    chosen = _native.ExciteOptions()
    _fill(chosen, {"robot": os.fspath(robot), **options})
    return _native.excite(chosen, progress)
