// JSON Schemas of the messages about the run.
#include "components/gateway/live/live.h"

namespace cotwin::gateway::live {

void Live::add_schemas(http::Router& router) {
  router.add_schema("Html", R"({"type": "string", "description": "HTML"})");
  router.add_schema("PageContent", R"({
    "type": "object", "description": "For the page of the same version only",
    "properties": {"format": {"type": "integer"}, "name": {"type": "string"}}, "required": ["format", "name"]})");
  router.add_schema("RunPhase", R"({"enum": ["running", "paused", "ended"]})");
  router.add_schema("RunPosition", R"({
    "type": "object",
    "properties": {
      "phase": {"$ref": "#/components/schemas/RunPhase"},
      "tick": {"type": "integer", "description": "Ticks that have ended"}, "time_s": {"type": "number"},
      "changes": {"type": "integer", "description": "Values that were set from outside"}},
    "required": ["phase", "tick", "time_s", "changes"], "additionalProperties": false})");
  router.add_schema("Run", R"({
    "type": "object",
    "properties": {
      "phase": {"$ref": "#/components/schemas/RunPhase"},
      "tick": {"type": "integer", "description": "Ticks that have ended"}, "time_s": {"type": "number"},
      "changes": {"type": "integer", "description": "Values that were set from outside"},
      "scenario": {"type": "string"}, "start_s": {"type": "number"}, "stop_s": {"type": "number"}, "tick_s": {"type": "number"},
      "ticks": {"type": "integer", "description": "Until the stop time"},
      "clock": {"enum": ["free", "wall", "arrivals", "locked"]},
      "can_pause": {"type": "boolean"}, "why_not": {"type": "string"}, "signals": {"type": "integer"},
      "has_page": {"type": "boolean", "description": "Whether GET /run/page has it"},
      "commands": {"type": "boolean", "description": "Whether this gateway takes commands to the run and sets its values"},
      "may": {"type": "array", "items": {"enum": ["read", "jobs", "tune", "acknowledge", "end"]}, "description": "What the one who asks may do now"}},
    "required": ["phase", "tick", "time_s", "changes", "scenario", "start_s", "stop_s", "tick_s", "ticks", "clock", "can_pause", "signals", "has_page", "commands", "may"],
    "additionalProperties": false})");
  router.add_schema("Element",
                    R"({"type": ["number", "boolean", "null"], "description": "null: a number that is not finite"})");
  router.add_schema("Values", R"({
    "anyOf": [{"$ref": "#/components/schemas/Element"}, {"type": "array", "items": {"$ref": "#/components/schemas/Element"}}],
    "description": "A value for one element, an array for all elements of a vector"})");
  router.add_schema("Signal", R"({
    "type": "object",
    "properties": {
      "name": {"type": "string"}, "component": {"type": "string"}, "variable": {"type": "string"},
      "type": {"enum": ["Real", "Integer", "Boolean", "String"]}, "size": {"type": "integer"},
      "causality": {"enum": ["input", "output", "parameter", "local"]},
      "variability": {"enum": ["fixed", "tunable", "discrete", "continuous"]},
      "settable": {"type": "boolean"}, "watchable": {"type": "boolean"}, "unit": {"type": "string"},
      "units": {"type": "array", "items": {"type": "string"}}, "joints": {"type": "array", "items": {"type": "string"}},
      "description": {"type": "string"}, "min": {"type": "number"}, "max": {"type": "number"},
      "start": {"$ref": "#/components/schemas/Values"}},
    "required": ["name", "component", "variable", "type", "size", "causality", "variability", "settable", "watchable"],
    "additionalProperties": false})");
  router.add_schema("Signals", R"({
    "type": "object", "properties": {"signals": {"type": "array", "items": {"$ref": "#/components/schemas/Signal"}}},
    "required": ["signals"], "additionalProperties": false})");
  router.add_schema("Record", R"({
    "type": "object", "description": "Values of one tick, by name",
    "properties": {
      "tick": {"type": "integer"}, "time_s": {"type": "number"},
      "values": {"type": "object", "additionalProperties": {"$ref": "#/components/schemas/Values"}}},
    "required": ["tick", "time_s", "values"], "additionalProperties": false})");
  router.add_schema("Sample", R"({
    "type": "object", "description": "Values of one tick, by name",
    "properties": {
      "tick": {"type": "integer"}, "time_s": {"type": "number"},
      "values": {"type": "object", "additionalProperties": {"$ref": "#/components/schemas/Values"}},
      "lost": {"type": "integer", "description": "Messages that were left out because the client was slow"}},
    "required": ["tick", "time_s", "values", "lost"], "additionalProperties": false})");
  router.add_schema("Samples", R"({
    "type": "object",
    "properties": {
      "samples": {"type": "array", "minItems": 1, "items": {"$ref": "#/components/schemas/Record"}},
      "lost": {"type": "integer", "description": "Records so far that came too fast for the client"}},
    "required": ["samples", "lost"], "additionalProperties": false})");
  router.add_schema("SetValue", R"({
    "description": "A number, true or false for all elements, or an array with one for each",
    "anyOf": [{"type": ["number", "boolean"]},
              {"type": "array", "minItems": 1, "maxItems": 256, "items": {"type": ["number", "boolean"]}}]})");
  router.add_schema("TunableValue", R"({
    "type": "object", "additionalProperties": false,
    "properties": {
      "value": {"$ref": "#/components/schemas/SetValue"},
      "time_s": {"type": "number", "description": "Time of the run from which it holds; default: the next tick"}},
    "required": ["value"]})");
  router.add_schema("RunCommand", R"({
    "oneOf": [
      {"type": "object", "additionalProperties": false, "required": ["command"],
       "properties": {"command": {"enum": ["pause", "resume", "stop"]}}},
      {"type": "object", "additionalProperties": false, "required": ["command", "ticks"],
       "properties": {
         "command": {"const": "step"},
         "ticks": {"type": "integer", "minimum": 1, "maximum": 1e15, "description": "Then the run pauses"}}},
      {"type": "object", "additionalProperties": false, "required": ["command", "values"],
       "properties": {
         "command": {"const": "set"},
         "values": {"type": "object", "minProperties": 1, "additionalProperties": {"$ref": "#/components/schemas/SetValue"},
                    "description": "Names and values, which hold from the same tick on"},
         "time_s": {"type": "number", "description": "Time of the run; default: the next tick"}}}]})");
  router.add_schema("Accepted", R"({
    "type": "object",
    "properties": {
      "command": {"enum": ["set", "pause", "resume", "step", "stop"]}, "time_s": {"type": "number"},
      "phase": {"$ref": "#/components/schemas/RunPhase"},
      "tick": {"type": "integer", "description": "The first tick that begins with the values, or that does not begin: pause, stop, step"}},
    "required": ["command", "tick", "time_s", "phase"], "additionalProperties": false})");
}

}  // namespace cotwin::gateway::live
