// JSON Schemas of the messages about the run.
#include "components/gateway/live/live.h"

namespace cotwin::gateway::live {

void Live::add_schemas(http::Router& router) {
  router.add_schema("Run", R"({
    "type": "object",
    "properties": {
      "phase": {"enum": ["running", "paused", "ended"]},
      "tick": {"type": "integer", "description": "Ticks that have ended"}, "time_s": {"type": "number"},
      "changes": {"type": "integer", "description": "Values that were set from outside"},
      "scenario": {"type": "string"}, "start_s": {"type": "number"}, "stop_s": {"type": "number"}, "tick_s": {"type": "number"},
      "ticks": {"type": "integer", "description": "Until the stop time"},
      "clock": {"enum": ["free", "wall", "arrivals", "locked"]},
      "can_pause": {"type": "boolean"}, "why_not": {"type": "string"}, "signals": {"type": "integer"}},
    "required": ["phase", "tick", "time_s", "changes", "scenario", "clock", "can_pause"]})");
  router.add_schema("Signal", R"({
    "type": "object",
    "properties": {
      "name": {"type": "string"}, "component": {"type": "string"}, "variable": {"type": "string"},
      "type": {"enum": ["Real", "Integer", "Boolean", "String"]}, "size": {"type": "integer"},
      "causality": {"enum": ["input", "output", "parameter", "local"]},
      "variability": {"enum": ["fixed", "tunable", "discrete", "continuous"]},
      "settable": {"type": "boolean"}, "watchable": {"type": "boolean"}, "unit": {"type": "string"},
      "description": {"type": "string"}, "min": {"type": "number"}, "max": {"type": "number"}, "start": {}},
    "required": ["name", "component", "variable", "type", "size", "causality", "variability", "settable", "watchable"]})");
  router.add_schema("Signals", R"({
    "type": "object", "properties": {"signals": {"type": "array", "items": {"$ref": "#/components/schemas/Signal"}}},
    "required": ["signals"]})");
  router.add_schema("Sample", R"({
    "type": "object", "description": "Values of one tick; null for a number that is not finite",
    "properties": {
      "tick": {"type": "integer"}, "time_s": {"type": "number"}, "values": {"type": "object"},
      "lost": {"type": "integer", "description": "Messages that were left out because the client was slow"}},
    "required": ["tick", "time_s", "values"]})");
  router.add_schema("TunableValue", R"({
    "type": "object", "additionalProperties": false,
    "properties": {
      "value": {"description": "A number, true or false for all elements, or an array with one for each"},
      "time_s": {"type": "number", "description": "Time of the run from which it holds; default: the next tick"}},
    "required": ["value"]})");
  router.add_schema("RunCommand", R"({
    "type": "object",
    "properties": {
      "command": {"enum": ["set", "pause", "resume", "step", "stop"]},
      "ticks": {"type": "integer", "minimum": 1, "description": "Of step: then the run pauses"},
      "values": {"type": "object", "description": "Of set: names and values, which hold from the same tick on"},
      "time_s": {"type": "number", "description": "Of set: time of the run; default: the next tick"}},
    "required": ["command"]})");
  router.add_schema("Accepted", R"({
    "type": "object",
    "properties": {
      "command": {"type": "string"}, "time_s": {"type": "number"}, "phase": {"enum": ["running", "paused", "ended"]},
      "tick": {"type": "integer", "description": "The first tick that begins with the values, or that does not begin: pause, stop, step"}},
    "required": ["command", "tick", "time_s", "phase"]})");
}

}  // namespace cotwin::gateway::live
