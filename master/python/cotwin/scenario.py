"""Scenarios that are built in Python and saved as SSD (SSP 1.0)."""

from __future__ import annotations

import difflib
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Iterable, Mapping
from xml.sax.saxutils import quoteattr

import numpy as np

from ._native import BadValue, Error, UnknownName, unit_names
from .masks import refuse_mask
from .unit import Unit, name_of

if TYPE_CHECKING:
    from .simulation import Result

_SPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


def text_of(place: str, value: Any) -> str:
    """A value as in scenarios: numbers with all their bits, vectors with blanks, truth values as true and false."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    refuse_mask(place, value)
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise BadValue(f"{place}: {value!r}, expected a text, a truth value, a number or numbers")
    if not np.all(np.isfinite(array)):
        raise BadValue(f"{place}: has a value that is not finite, expected finite numbers")
    return " ".join(repr(one) for one in array.ravel().tolist())


def _attributes(**given: Any) -> str:
    return "".join(f" {k}={quoteattr(text_of(k, v))}" for k, v in given.items() if v is not None)


def _setting(value: str) -> str:
    """A name or value in the query of a source."""
    return re.sub("[%&=\x00-\x1f\x7f]", lambda m: f"%{ord(m[0]):02X}", value)


class Scenario:
    """A scenario: components, their connections, and how they are run. docs/scenario.md explains what can be chosen.

        arm = cotwin.Scenario("arm", robot="lwr4", stop=2)
        arm.add("motion", kind="waypoints", points=2, values={"waypoint_t": [0.1, 1.5], "waypoint_q": [q0, q1]})
        arm.add("compliance")
        arm.add("drive", "drive_train", values={"q0": q0})
        arm.connect("motion", "compliance", "q_d dq_d ddq_d")
        arm.connect("compliance", "drive", "tau_m")
        arm.connect("drive", "compliance", "q dq theta dtheta")
        arm.save("arm.ssd")
        tau = arm.run()["drive.tau_J"]

    name       of the scenario
    start, stop, tick  times in s
    robot      setting of all units that have it: URDF, or the name of a robot
    settings   further settings of all units
    clock, coupling, tolerance, threads  as in docs/scenario.md, "Our annotation"
    every      number of ticks per recorded row
    folder     where relative paths of values are looked up in a run that was not saved
    """

    def __init__(
        self,
        name: str = "scenario",
        *,
        stop: float = 1.0,
        start: float = 0.0,
        tick: float = 1e-3,
        robot: str | os.PathLike[str] | None = None,
        settings: Mapping[str, Any] | None = None,
        clock: str | None = None,
        coupling: str | None = None,
        tolerance: float | None = None,
        threads: int | None = None,
        every: int = 1,
        folder: str | os.PathLike[str] = ".",
    ):
        self.name = name
        self.start, self.stop, self.tick = start, stop, tick
        self.settings: dict[str, Any] = dict(settings or {})
        if robot is not None:
            self.settings["robot"] = robot
        self.clock, self.coupling, self.tolerance, self.threads, self.every = clock, coupling, tolerance, threads, every
        self.folder = folder
        self.units: dict[str, Any] = {}
        self._components: dict[str, dict[str, Any]] = {}
        self._connections: list[str] = []
        self._events: list[str] = []
        self._recorded: list[str] = []
        self._reports: list[str] = []

    # What runs.

    def add(
        self,
        name: str,
        unit: str | os.PathLike[str] | type[Unit] | None = None,
        *,
        values: Mapping[str, Any] | None = None,
        ssv: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
        stage: int | None = None,
        period: int = 1,
        beside: bool = False,
        **settings: Any,
    ) -> Scenario:
        """Adds a component.

        unit      a unit of Cotwin, "drive_train"; "unit:mine" of `units` or `modules` of the run; a class derived from cotwin.Unit;
                  a file *.fmu; None: the name
        values    start values of parameters, inputs and states: numbers, vectors, texts
        ssv       files with parameter values, before `values`
        stage     stages run one after another within a tick; None: after all components that were added before
        period    ticks per step
        beside    steps on a thread of its own
        settings  of the unit: kind="waypoints"
        """
        if name in self._components:
            raise Error(f"component '{name}': added twice, expected another name")
        source = name if unit is None else unit
        if isinstance(source, type):
            if not issubclass(source, Unit):
                raise Error(f"component '{name}': {source!r}, expected a class derived from cotwin.Unit")
            if settings:
                raise Error(f"component '{name}': settings {', '.join(settings)}, expected none for a unit in Python; give it parameters")
            kind = name_of(source)
            if self.units.setdefault(kind, source) is not source:
                raise Error(f"component '{name}': another class is already the unit '{kind}', expected another name")
            source = f"unit:{kind}"
        else:
            source = os.fspath(source)
            if not source.endswith(".fmu") and not source.startswith("unit:"):
                kind, known = source.split("?")[0], [*unit_names(), *self.units]
                if kind not in known:
                    near = difflib.get_close_matches(kind, known, 1)
                    raise UnknownName(
                        f"component '{name}': no unit '{kind}', expected one of {', '.join(known)}, or unit:{kind} of `units` or `modules` of the run"
                        + (f"; did you mean '{near[0]}'?" if near else "")
                    )
                source = f"unit:{source}"
        if settings:
            query = "&".join(f"{_setting(k)}={_setting(text_of(f'{name}: {k}', v))}" for k, v in settings.items())
            source += ("&" if "?" in source else "?") + query
        files = [ssv] if isinstance(ssv, (str, os.PathLike)) else list(ssv)
        self._components[name] = {
            "source": source,
            "values": {k: text_of(f"{name}.{k}", v) for k, v in (values or {}).items()},
            "ssv": [os.fspath(file) for file in files],
            "stage": len(self._components) if stage is None else stage,
            "period": period,
            "beside": beside,
        }
        return self

    def connect(
        self,
        source: str,
        target: str,
        variables: str | Mapping[str, str] | None = None,
        *,
        factor: float | None = None,
        offset: float | None = None,
    ) -> Scenario:
        """Connects outputs with inputs.

        connect("motion", "drive", "q_d dq_d")      variables of the same name
        connect("drive", "world", {"q": "q_m"})     of other names
        connect("motion.q_d[2]", "drive.q_d[1]")    one connection; target = factor · source + offset
        """
        if variables is None:
            pairs = [(self._split(source), self._split(target))]
        else:
            names = variables.items() if isinstance(variables, Mapping) else [(v, v) for v in variables.split()]
            pairs = [((self._known(source), a), (self._known(target), b)) for a, b in names]
        for (from_component, output), (to_component, input_) in pairs:
            ends = _attributes(startElement=from_component, startConnector=output, endElement=to_component, endConnector=input_)
            if factor is None and offset is None:
                self._connections.append(f"<ssd:Connection{ends}/>")
            else:
                change = _attributes(factor=1.0 if factor is None else factor, offset=0.0 if offset is None else offset)
                self._connections.append(f"<ssd:Connection{ends}><ssc:LinearTransformation{change}/></ssd:Connection>")
        return self

    def _known(self, component: str) -> str:
        if component not in self._components:
            raise UnknownName(f"connect: no component '{component}', expected one of {', '.join(self._components) or 'those added before'}")
        return component

    def _split(self, port: str) -> tuple[str, str]:
        for component in sorted(self._components, key=len, reverse=True):
            if port.startswith(component + "."):
                return component, port[len(component) + 1 :]
        raise Error(f"connect: '{port}' begins with no component, expected component.variable")

    def event(self, time: float, variable: str, value: Any, *, ramp: float | None = None) -> Scenario:
        """From `time` (s) on, an unconnected input or a tunable has this value; with `ramp` (s) it gets there linearly."""
        self._events.append(f"<cotwin:Event{_attributes(time=time, variable=variable, value=value, ramp=ramp)}/>")
        return self

    def attach(self, time: float, tool: str, parent: str, **attributes: Any) -> Scenario:
        """At `time` (s) a tool is mounted on the frame `parent`: mass, com, inertia, xyz, rpy, file, robot, known, reason."""
        self._events.append(f"<cotwin:Event{_attributes(time=time, attach=tool, parent=parent, **attributes)}/>")
        return self

    def detach(self, time: float, tool: str, **attributes: Any) -> Scenario:
        """At `time` (s) the tool is removed."""
        self._events.append(f"<cotwin:Event{_attributes(time=time, detach=tool, **attributes)}/>")
        return self

    # What is recorded and reported.

    def record(self, *variables: str) -> Scenario:
        """Records variables: "drive.q", "drive.*", "*.tau_J". Without any, all outputs are recorded."""
        self._recorded += variables
        return self

    def report(self, name: str, a: str, b: str | None = None, *, kind: str | None = None) -> Scenario:
        """RMS and largest magnitude of `a`, or of `a` − `b`; kind="attitude": of the rotation vector from quaternion b to a; kind="energy": the integral of `a` · `b`."""
        kind = kind or ("signal" if b is None else "difference")
        self._reports.append(f"<cotwin:Report{_attributes(name=name, kind=kind, a=a, b=b)}/>")
        return self

    def compare(self, name: str, a: str, b: str, **attributes: Any) -> Scenario:
        """Compares two signals at the end of the run: segments, from_, to."""
        attributes = {k.rstrip("_"): v for k, v in attributes.items()}
        self._reports.append(f"<cotwin:Comparison{_attributes(name=name, a=a, b=b, **attributes)}/>")
        return self

    def bond(self, name: str, effort_a: str, flow_a: str, effort_b: str, flow_b: str, *, tolerance: float | None = None) -> Scenario:
        """Power that leaves side A and enters side B; `tolerance` (J): a larger leak is reported."""
        ends = _attributes(name=name, effortA=effort_a, flowA=flow_a, effortB=effort_b, flowB=flow_b, tolerance=tolerance)
        self._reports.append(f"<cotwin:Bond{ends}/>")
        return self

    # What becomes of it.

    def to_ssd(self) -> str:
        """The scenario as the text of an .ssd file."""
        spaces = "".join(f"\n    xmlns:{k}={quoteattr(v)}" for k, v in _SPACES.items())
        out = ['<?xml version="1.0" encoding="UTF-8"?>']
        out.append(f'<ssd:SystemStructureDescription version="1.0"{_attributes(name=self.name)}{spaces}>')
        out += [f"  <ssd:System{_attributes(name=self.name)}>", "    <ssd:Elements>"]
        for name, component in self._components.items():
            out += self._component(name, component)
        out.append("    </ssd:Elements>")
        if self._connections:
            out += ["    <ssd:Connections>", *("      " + c for c in self._connections), "    </ssd:Connections>"]
        out += ["  </ssd:System>", f"  <ssd:DefaultExperiment{_attributes(startTime=self.start, stopTime=self.stop)}/>"]
        out += ["  <ssd:Annotations>", '    <ssc:Annotation type="cotwin.master">']
        master = _attributes(
            tick=self.tick, clock=self.clock, coupling=self.coupling, tolerance=self.tolerance, threads=self.threads
        )
        out.append(f'      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1"{master}>')
        inner = [f"<cotwin:Setting{_attributes(name=k, value=v)}/>" for k, v in self.settings.items()]
        for name, c in self._components.items():
            period = None if c["period"] == 1 else c["period"]
            inner.append(f"<cotwin:Component{_attributes(name=name, stage=c['stage'], period=period, beside=c['beside'] or None)}/>")
        inner += self._events
        if self._recorded or self.every != 1:
            inner.append(f"<cotwin:Recording{_attributes(decimation=self.every)}>")
            inner += [f"  <cotwin:Record{_attributes(variables=v)}/>" for v in self._recorded]
            inner.append("</cotwin:Recording>")
        inner += self._reports
        out += ["        " + line for line in inner]
        out += ["      </cotwin:Master>", "    </ssc:Annotation>", "  </ssd:Annotations>", "</ssd:SystemStructureDescription>"]
        return "\n".join(out) + "\n"

    @staticmethod
    def _component(name: str, component: Mapping[str, Any]) -> list[str]:
        source = component["source"]
        kind = "application/x-cotwin-unit" if source.startswith("unit:") else None
        start = f"      <ssd:Component{_attributes(name=name, source=source, type=kind)}"
        if not component["values"] and not component["ssv"]:
            return [start + "/>"]
        out = [start + ">", "        <ssd:ParameterBindings>"]
        out += [f"          <ssd:ParameterBinding{_attributes(source=file)}/>" for file in component["ssv"]]
        if component["values"]:
            out += ["          <ssd:ParameterBinding>", "            <ssd:ParameterValues>"]
            out += ['              <ssv:ParameterSet version="1.0" name="values">', "                <ssv:Parameters>"]
            for parameter, value in component["values"].items():
                inner = f"<ssv:String{_attributes(value=value)}/>"
                out.append(f"                  <ssv:Parameter{_attributes(name=parameter)}>{inner}</ssv:Parameter>")
            out += ["                </ssv:Parameters>", "              </ssv:ParameterSet>"]
            out += ["            </ssd:ParameterValues>", "          </ssd:ParameterBinding>"]
        return out + ["        </ssd:ParameterBindings>", "      </ssd:Component>"]

    def save(self, file: str | os.PathLike[str]) -> Path:
        """Writes the scenario as .ssd. Units in Python are named in it, not contained."""
        path = Path(file)
        path.write_text(self.to_ssd(), encoding="utf-8")
        return path

    def run(self, **options: Any) -> Result:
        """Runs the scenario to its end. Options as for Simulation."""
        from .simulation import run

        return run(self, **options)

    def __repr__(self) -> str:
        return f"<Scenario {self.name}: {', '.join(self._components)}>"
