"""The services: what a motion costs, and which one is better (docs/services.md)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Callable, Iterable, Mapping

import numpy as np

from . import _native
from ._native import BadValue
from .masks import refuse_mask


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        refuse_mask("request", value)
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} is no value of JSON")


def ask(
    request: Mapping[str, Any],
    *,
    robot: str | os.PathLike[str] = "lwr4",
    robots: Iterable[str | os.PathLike[str]] = (),
    threads: int | None = None,
    progress: Callable[[float, str], Any] | None = None,
) -> dict[str, Any]:
    """Answers a question about a motion, as `cotwin ask`.

        reply = cotwin.ask({"service": "energy", "from_q_rad": q0, "to_q_rad": q1, "T_s": 2.0})

    request   members with units of measure in their names (docs/services.md, service_schema()); arrays are allowed
    robot     of a request that names none: URDF, or the name of a robot
    robots    folders with robots, in place of those of Cotwin
    threads   of a search; None: one per core. The reply does not depend on them
    progress  called with the share that is done, 0 to 1, and a text; the search ends with an Error if it returns False

    The same request gives the same reply. Ctrl-C ends a search at the next percent of its rounds.
    """
    try:
        text = json.dumps(dict(request), default=_plain, allow_nan=False)
    except BadValue:
        raise
    except (TypeError, ValueError) as error:
        raise BadValue(f"request: {error}, expected texts, truth values, finite numbers, lists and dictionaries") from error
    count = (os.cpu_count() or 1) if threads is None else threads
    return json.loads(_native.ask(text, os.fspath(robot), [Path(one) for one in robots], count, progress))


def service_names() -> list[str]:
    """The names of the services: "feasibility", "energy" …"""
    return _native.service_names()


def service_schema(service: str) -> dict[str, Any]:
    """The JSON Schemas of a service: {"title", "description", "request", "reply"}."""
    return json.loads(_native.service_schema(service))
