// Schemas of jobs: the types of OPC 10031-4.
#include "components/gateway/api/api.h"

namespace cotwin::gateway {

void add_job_schemas(http::Router& router) {
  router.add_schema("JobState", R"({
    "type": "array", "minItems": 1, "description": "ISA95StateDataType[] of OPC 10031-4, the first one is the top state",
    "items": {"type": "object", "properties": {
      "BrowsePath": {"type": ["string", "null"]},
      "StateText": {"enum": ["NotAllowedToStart", "AllowedToStart", "Running", "Interrupted", "Ended", "Aborted"]},
      "StateNumber": {"type": "integer", "minimum": 1, "maximum": 6}},
      "required": ["BrowsePath", "StateText", "StateNumber"], "additionalProperties": false}})");
  router.add_schema("JobParameter", R"({
    "type": "object", "description": "ISA95ParameterDataType",
    "properties": {"ID": {"type": "string"}, "Value": true}, "required": ["ID", "Value"], "additionalProperties": false})");
  router.add_schema("OrderParameter", R"({
    "type": "object", "description": "ISA95ParameterDataType of an order",
    "properties": {"ID": {"enum": ["Request", "Deadline", "TimeLimit", "Reuse"]}, "Value": true},
    "required": ["ID", "Value"], "additionalProperties": false,
    "oneOf": [
      {"properties": {"ID": {"const": "Request"}, "Value": {"$ref": "#/components/schemas/OrderRequest"}}},
      {"properties": {"ID": {"const": "Deadline"}, "Value": {"type": "string", "format": "date-time"}}},
      {"properties": {"ID": {"const": "TimeLimit"}, "Value": {"type": "number", "exclusiveMinimum": 0, "maximum": 1e6, "description": "s of running"}}},
      {"properties": {"ID": {"const": "Reuse"}, "Value": {"type": "boolean", "description": "false: compute again"}}}]})");
  router.add_schema("JobOrder", R"({
    "type": "object", "description": "ISA95JobOrderDataType",
    "properties": {
      "JobOrderID": {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-.0-~]+$"},
      "Description": {"type": "array", "maxItems": 64, "items": {"$ref": "#/components/schemas/LocalizedText"}},
      "WorkMasterID": {"type": "array", "minItems": 1, "maxItems": 1, "description": "the service of the request",
        "items": {"type": "object", "properties": {"ID": {"type": "string"}}, "required": ["ID"]}},
      "StartTime": {"type": "string", "format": "date-time"}, "EndTime": {"type": "string", "format": "date-time"},
      "Priority": {"type": "integer", "minimum": -32768, "maximum": 32767, "description": "higher is more urgent"},
      "JobOrderParameters": {"type": "array", "items": {"$ref": "#/components/schemas/OrderParameter"},
        "contains": {"properties": {"ID": {"const": "Request"}}}}},
    "required": ["JobOrderParameters"], "additionalProperties": false})");
  router.add_schema("JobOrderAndState", R"({
    "type": "object",
    "properties": {
      "JobOrder": {"type": "object", "description": "JobOrder as it was stored; its request may be one that the service refuses",
        "properties": {
          "JobOrderID": {"type": "string"}, "Description": {"type": "array", "items": {"$ref": "#/components/schemas/LocalizedText"}},
          "WorkMasterID": {"type": "array", "items": {"type": "object", "properties": {"ID": {"type": "string"}}, "required": ["ID"]}},
          "StartTime": {"type": "string", "format": "date-time"}, "EndTime": {"type": "string", "format": "date-time"},
          "Priority": {"type": "integer"}, "JobOrderParameters": {"type": "array", "items": {"$ref": "#/components/schemas/JobParameter"}}},
        "required": ["JobOrderID", "Description", "WorkMasterID", "Priority", "JobOrderParameters"], "additionalProperties": false},
      "State": {"$ref": "#/components/schemas/JobState"},
      "JobExecutionMode": {"const": "SimulationMode"}, "JobResult": {"enum": ["Unknown", "Successful", "Unsuccessful"]},
      "Progress": {"type": "number", "minimum": 0, "maximum": 1}, "ProgressMessage": {"type": "string"},
      "Light": {"enum": ["green", "amber", "red"]}, "ReasonForStateChange": {"type": "string"}, "Stored": {"type": "string", "format": "date-time"}, "Version": {"type": "integer"}},
    "required": ["JobOrder", "State", "JobExecutionMode", "JobResult", "Progress", "Stored", "Version"], "additionalProperties": false})");
  router.add_schema("JobOrders", R"({
    "type": "object",
    "properties": {"JobOrders": {"type": "array", "items": {"$ref": "#/components/schemas/JobOrderAndState"}},
                   "Next": {"type": "string", "description": "cursor of the next page; empty: this is the last one"}},
    "required": ["JobOrders", "Next"], "additionalProperties": false})");
  router.add_schema("JobCommand", R"({
    "type": "object",
    "properties": {"Command": {"enum": ["Start", "RevokeStart", "Pause", "Resume", "Stop", "Abort", "Cancel", "Clear"]},
                   "Comment": {"type": "array", "maxItems": 64, "items": {"$ref": "#/components/schemas/LocalizedText"}}},
    "required": ["Command"], "additionalProperties": false})");
  router.add_schema("JobResponse", R"({
    "type": "object", "description": "ISA95JobResponseDataType; Reply among the data is the reply of the service, byte for byte",
    "properties": {
      "JobResponseID": {"type": "string"}, "JobOrderID": {"type": "string"}, "StartTime": {"type": "string", "format": "date-time"},
      "EndTime": {"type": "string", "format": "date-time"}, "JobState": {"$ref": "#/components/schemas/JobState"},
      "JobResponseData": {"type": "array", "items": {"$ref": "#/components/schemas/JobParameter"}}},
    "required": ["JobResponseID", "JobOrderID", "JobState", "JobResponseData"], "additionalProperties": false})");
  router.add_schema("Result", R"({
    "type": "object",
    "properties": {
      "Number": {"type": "integer"}, "JobOrderID": {"type": "string"}, "Service": {"type": "string"}, "Robot": {"type": "string"},
      "RequestHash": {"type": "string"}, "RobotHash": {"type": "string"}, "Producer": {"type": "string"},
      "Stored": {"type": "string", "format": "date-time"}, "Busy_s": {"type": "number"}, "Reused": {"type": "boolean"},
      "Bytes": {"type": "integer", "description": "of the reply"}, "Request": {"$ref": "#/components/schemas/OrderRequest"},
      "Reply": {"$ref": "#/components/schemas/OrderReply"}},
    "required": ["Number", "JobOrderID", "Service", "Robot", "RequestHash", "RobotHash", "Producer", "Stored", "Busy_s", "Reused", "Bytes", "Request"],
    "additionalProperties": false})");
  router.add_schema("Results", R"({
    "type": "object",
    "properties": {"Results": {"type": "array", "items": {"$ref": "#/components/schemas/Result"}},
                   "Next": {"type": "string", "description": "cursor of the next page; empty: this is the last one"}},
    "required": ["Results", "Next"], "additionalProperties": false})");
  router.add_schema("JobEvent", R"({
    "type": "object",
    "properties": {
      "JobOrderID": {"type": "string"}, "Change": {"enum": ["state", "order", "progress", "removed"]}, "State": {"$ref": "#/components/schemas/JobState"},
      "JobResult": {"enum": ["Unknown", "Successful", "Unsuccessful"]}, "Progress": {"type": "number"}, "ProgressMessage": {"type": "string"},
      "Light": {"enum": ["green", "amber", "red"]}, "ReasonForStateChange": {"type": "string"}},
    "required": ["JobOrderID", "Change", "State", "JobResult", "Progress"], "additionalProperties": false})");
}

}  // namespace cotwin::gateway
