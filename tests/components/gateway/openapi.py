"""Checks a running gateway against its own OpenAPI document: every path and verb with valid and with wrong requests. Each answer must have a
status that the document names for the operation, the type and the header fields that it names for the status, and a body that its schema
admits; each body that the gateway takes or refuses for its form must be taken or refused by the schema, too.

usage: openapi.py RUN TOKENS PLAIN: ports at 127.0.0.1 of a gateway in a run, of one with the tokens READ and OPERATE, and of one
without jobs. Prints what is wrong, one line each."""
import base64
import concurrent.futures
import datetime
import http.client
import json
import os
import socket
import sys
import time
import urllib.parse

import jsonschema

READ, OPERATE = "0123456789abcdef-read", "0123456789abcdef-operate"
WORDS = ("read", "jobs", "tune", "acknowledge", "end")

# Who may do what, as docs/gateway.md says. A route that is not here is for everybody who may read.
CHANGES = {
    ("POST", "/job-orders"): {"jobs"},
    ("PUT", "/job-orders/{id}"): {"jobs"},
    ("DELETE", "/job-orders/{id}"): {"jobs"},
    ("POST", "/job-orders/{id}/commands"): {"jobs"},
    ("PUT", "/run/tunables/{name}"): {"tune", "acknowledge"},
    ("POST", "/run/commands"): {"tune", "acknowledge", "end"},
}
OPEN = {("GET", "/"), ("GET", "/health"), ("GET", "/openapi.json")}
MOVE = {"robot": "lwr4", "from_q_rad": [0, -0.9, 0, 1.2, 0, 0.6, 0], "to_q_rad": [1.2, 0.9, 0, -1.2, 0, -0.6, 0]}
SEARCH = {"service": "optimise", **MOVE, "T_min_s": 2.0, "degree": 7, "cost": "torque", "particles": 16, "rounds": 5, "refine": False}
LONG = {**SEARCH, "particles": 2000, "rounds": 100000}
JSON, PROBLEM, EVENTS = "application/json", "application/problem+json", "text/event-stream"
HTML = "text/html"
TIMEOUT = 120  # s

# Statuses that the document names and this program does not bring about: overload, jobs whose workers die, a run that has ended (the
# server ends with it). Tests in C++ bring these about.
ELSEWHERE = {429, 500, 503}
AFTER_THE_RUN = {("GET", "/run/values"), ("GET", "/run/stream"), ("POST", "/services"), ("POST", "/services/{name}")}

wrong = []


def expect(condition, *what):
    if not condition:
        wrong.append(" ".join(str(w)[:600] for w in what))


formats = jsonschema.FormatChecker()


@formats.checks("date-time", raises=ValueError)
def is_time(text):
    return not isinstance(text, str) or bool(datetime.datetime.fromisoformat(text.replace("Z", "+00:00")))


class Gateway:
    """One server and what its document says."""

    def __init__(self, port, token=None):
        self.port, self.token = port, token
        self.covered = {}
        status, _, body = self.send("GET", "/openapi.json")
        expect(status == 200, "/openapi.json gives", status)
        self.document = json.loads(body)

    def send(self, method, target, body=None, fields=(), only_header=False):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT)
        connection.putrequest(method, target, skip_accept_encoding=True)
        fields = dict(fields)
        if self.token and "Authorization" not in fields:
            fields["Authorization"] = "Bearer " + self.token
        if body is not None:
            fields.setdefault("Content-Type", JSON)
            fields.setdefault("Content-Length", str(len(body)))
        for name, value in fields.items():
            if value is None:
                continue
            connection.putheader(name, value)
        connection.endheaders(None if only_header else body)
        reply = connection.getresponse()
        streams = reply.getheader("Content-Type", "").startswith(EVENTS) and method != "HEAD"
        text = b"" if streams else reply.read()
        connection.close()
        return reply.status, reply, text.decode()

    def validator(self, schema):
        return jsonschema.Draft202012Validator({**schema, "components": self.document["components"]}, format_checker=formats)

    def flaw(self, schema, value):
        """The first thing that the schema does not admit; None: it admits the value."""
        error = jsonschema.exceptions.best_match(self.validator(schema).iter_errors(value))
        return error and f"{error.json_path}: {error.message[:300]}"

    def operation(self, method, path):
        return self.document["paths"][path][method.lower()]

    def call(self, method, path, status, part=None, query=None, body=None, fields=(), well_formed=None, only_header=False):
        """Sends a request and checks the answer. `part`: of the path. `body`: a value, or bytes that are no JSON. `well_formed`: whether the
        schemas admit body and query; by default where the status is no error. Returns the answer's value and its header."""
        operation = self.operation(method, path)
        place = f"{method} {path} {part or ''} {query or ''}"
        well_formed = status < 400 if well_formed is None else well_formed
        target = path
        for name, value in (part or {}).items():
            target = target.replace("{" + name + "}", urllib.parse.quote(value, safe=""))
        if query:
            target += "?" + urllib.parse.urlencode(query)
        declared = {(p["in"], p["name"]): p for p in operation.get("parameters", [])}
        if well_formed:
            for kind, values in (("query", query), ("path", part), ("header", dict(fields))):
                for name, value in (values or {}).items():
                    if kind == "header" and name in ("Accept", "Authorization", "Content-Type"):
                        continue
                    expect((kind, name) in declared, place, "uses", kind, name, "which is not described")
                    schema = declared.get((kind, name), {}).get("schema", {})
                    typed = json.loads(value) if schema.get("type") in ("number", "integer", "boolean") else value
                    expect(not self.flaw(schema, typed), place, name, self.flaw(schema, typed))
        if body is not None and not isinstance(body, bytes):
            expect("requestBody" in operation, place, "has no body in the document")
            flaw = self.flaw(operation["requestBody"]["content"][JSON]["schema"], body)
            expect(well_formed == (flaw is None), place, "body", body, "is refused by the schema:" if flaw else "passes the schema", flaw)
        sent = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        got, reply, text = self.send(method, target, sent, fields, only_header)
        expect(got == status, place, "gives", got, "expected", status, text)
        return self.check_answer(method, path, place, got, reply, text), reply

    def check_answer(self, method, path, place, status, reply, text):
        operation = self.operation(method, path)
        self.covered.setdefault((method, path), set()).add(status)
        answer = operation["responses"].get(str(status))
        expect(answer is not None, place, "gives", status, "which the document does not name", text)
        if answer is None:
            return None
        for name in answer.get("headers", {}):
            expect(reply.getheader(name) is not None, place, status, "has no field", name)
        content = answer.get("content", {})
        given = (reply.getheader("Content-Type") or "").split(";")[0]
        expect((given in content) if content else not text, place, status, "is of type", given, "expected", list(content))
        if not content or given == EVENTS or given not in content:
            return None
        value = text if given == HTML else json.loads(text)
        flaw = self.flaw(content[given]["schema"], value)
        expect(flaw is None, place, status, "has an answer that its schema does not admit:", flaw, text[:300])
        if given == PROBLEM:
            expect(value["status"] == status and len(value.get("detail", "")) > 5, place, "problem", text)
        return value

    def message(self, path, name, data):
        """Checks an event of a stream."""
        known = self.operation("GET", path)["responses"]["200"].get("content", {}).get(EVENTS, {}).get("x-messages", {})
        expect(name in known, path, "sends the event", name, "which is not described")
        if name in known:
            flaw = self.flaw(known[name]["schema"], data)
            expect(flaw is None, path, "event", name, flaw, data)
        self.covered.setdefault(("GET", path), set()).add(name)


def events(gateway, path, query="", fields=()):
    """Opens a stream of server-sent events. Returns a generator of pairs of name and data."""
    stream = socket.create_connection(("127.0.0.1", gateway.port), timeout=TIMEOUT)
    head = "".join(f"{k}: {v}\r\n" for k, v in dict(fields).items())
    stream.sendall(f"GET {path}{query} HTTP/1.1\r\nHost: localhost\r\n{head}\r\n".encode())
    lines = stream.makefile("r", encoding="utf-8", newline="\n")
    status = int(lines.readline().split()[1])
    expect(status == 200, path, query, "gives", status)
    while lines.readline().strip():
        pass
    return events_of(gateway, path, lines)


def events_of(gateway, path, lines):
    name = data = ""
    for line in lines:
        key, _, value = line.rstrip("\n").partition(": ")
        if key == "event":
            name = value
        elif key == "data":
            data += value
        elif not key and name:
            value = json.loads(data)
            gateway.message(path, name, value)
            yield name, value
            name = data = ""


def web_socket_messages(gateway, path, query, count):
    """The first messages of a WebSocket (RFC 6455)."""
    stream = socket.create_connection(("127.0.0.1", gateway.port), timeout=TIMEOUT)
    key = base64.b64encode(os.urandom(16)).decode()
    stream.sendall(f"GET {path}{query} HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                   f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    reader = stream.makefile("rb")
    status = int(reader.readline().split()[1])
    expect(status == 101, path, "as a WebSocket gives", status)
    while reader.readline().strip():
        pass
    gateway.covered.setdefault(("GET", path), set()).add(101)
    while count > 0:
        kind, size = reader.read(2)
        if size == 126:
            size = int.from_bytes(reader.read(2), "big")
        elif size == 127:
            size = int.from_bytes(reader.read(8), "big")
        text = reader.read(size)
        if kind & 15 != 1:
            continue
        message = json.loads(text)
        expect({"event", "data"} <= set(message) <= {"event", "id", "data"}, path, "message", message)
        gateway.message(path, message["event"], message["data"])
        count -= 1
    stream.close()


# The members of OpenAPI 3.1.1 that are used here: allowed, and of these required.
OBJECTS = {
    "document": ("openapi info jsonSchemaDialect servers paths components", "openapi info paths"),
    "info": ("title version summary license", "title version"),
    "operation": ("operationId summary tags parameters requestBody responses security x-scopes", "operationId responses"),
    "parameter": ("name in description required schema", "name in schema"),
    "requestBody": ("required content", "content"),
    "response": ("description headers content", "description"),
    "header": ("description required schema", "schema"),
    "media": ("schema x-messages", "schema"),
    "components": ("schemas securitySchemes", ""),
}


def check_object(kind, value, place):
    allowed, required = (set(names.split()) for names in OBJECTS[kind])
    expect(set(value) <= allowed, place, kind, "has", set(value) - allowed)
    expect(required <= set(value), place, kind, "lacks", required - set(value))


def references(value):
    if isinstance(value, dict):
        if isinstance(value.get("$ref"), str):
            yield value["$ref"]
        for member in value.values():
            yield from references(member)
    elif isinstance(value, list):
        for member in value:
            yield from references(member)


def check_document(document):
    check_object("document", document, "")
    check_object("info", document["info"], "")
    check_object("components", document["components"], "")
    expect(document["openapi"].startswith("3.1."), "openapi", document["openapi"])
    schemas = document["components"]["schemas"]
    for name, schema in schemas.items():
        jsonschema.Draft202012Validator.check_schema(schema)
        expect("$schema" not in schema, name, "has $schema, which only a root may have")
    ids = set()
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            place = f"{method} {path}"
            check_object("operation", operation, place)
            expect(operation["operationId"] not in ids, place, "operationId is there twice")
            ids.add(operation["operationId"])
            seen = set()
            for parameter in operation.get("parameters", []):
                check_object("parameter", parameter, place)
                jsonschema.Draft202012Validator.check_schema(parameter["schema"])
                expect((parameter["in"], parameter["name"]) not in seen, place, parameter["name"], "is there twice")
                seen.add((parameter["in"], parameter["name"]))
                expect(parameter["in"] != "path" or parameter.get("required") is True, place, parameter["name"], "is not required")
            parts = {part.split("}")[0] for part in path.split("{")[1:]}
            expect(parts == {name for kind, name in seen if kind == "path"}, place, "parts of the path", seen)
            contents = []
            if "requestBody" in operation:
                check_object("requestBody", operation["requestBody"], place)
                contents.append(operation["requestBody"]["content"])
            for status, answer in operation["responses"].items():
                check_object("response", answer, place + " " + status)
                for header in answer.get("headers", {}).values():
                    check_object("header", header, place)
                contents.append(answer.get("content", {}))
            for content in contents:
                for media in content.values():
                    check_object("media", media, place)
    used = set(references(document["paths"]))
    while True:
        more = used | {r for u in used for r in references(schemas.get(u.rpartition("/")[2], {}))}
        if more == used:
            break
        used = more
    names = {"#/components/schemas/" + name for name in schemas}
    expect(used <= names, "unknown references", used - names)
    expect(names <= used, "schemas that nothing uses", names - used)


def wrong_calls(gateway, parts):
    """The same wrong requests to every operation."""
    for path, operations in gateway.document["paths"].items():
        for verb, operation in operations.items():
            method, part = verb.upper(), parts.get(path)
            takes = "requestBody" in operation
            body = b"{}" if takes else None
            gateway.call(method, path, 400, part, {"nonsense": "1"}, body)
            if "406" in operation["responses"]:
                gateway.call(method, path, 406, part, body=body, fields={"Accept": "image/png"})
            if not takes:
                gateway.call(method, path, 415, part, body=b"{}")
                continue
            gateway.call(method, path, 415, part, body=b"{}", fields={"Content-Type": "text/plain"})
            gateway.call(method, path, 413, part, body=b"", fields={"Content-Length": "100000000"}, only_header=True)
            gateway.call(method, path, 422, part, body={"nonsense": 1})
            for text in (b"", b"[]", b"{", b'{"a":1e999}', b'{"a":1,"a":2}', b"[" * 100000, b'{"a":"\xff"}'):
                gateway.call(method, path, 400, part, body=text)


def ended(gateway, job):
    for _ in range(10):
        value, _ = gateway.call("GET", "/job-responses/{id}", 200, {"id": job}, {"wait": "30"})
        if value["JobState"][0]["StateNumber"] >= 5:
            return value
    raise SystemExit("the job " + job + " does not end")


def order(request, job=None, **more):
    value = {"JobOrderParameters": [{"ID": "Request", "Value": request}], **more}
    return {"JobOrderID": job, **value} if job else value


def check_services(g):
    for path in ("/", "/health", "/robots", "/work-masters", "/openapi.json", "/run", "/run/signals"):
        value, _ = g.call("GET", path, 200)
        status, _, text = g.send("HEAD", path)
        expect(status == 200 and not text, "HEAD", path, status, text)
        if path == "/work-masters":
            masters = value["WorkMasters"]
    g.call("POST", "/tickets", 201)
    g.call("GET", "/robots/{name}", 200, {"name": "lwr4"})
    g.call("GET", "/robots/{name}", 404, {"name": "nobody"})
    g.call("GET", "/work-masters/{name}", 404, {"name": "nobody"})
    special = {
        "throughput": {"M_kg": 10, "S_N_per_m": 1000, "zeta": 0.7},
        "optimise": {k: v for k, v in SEARCH.items() if k not in ("service", *MOVE)},
        "grow": {"T_min_s": 1, "T_max_s": 3, "motions": 1000},
        "energy": {"best": True},
        # Near, and of the orientation the axis only: within the waiting time also in a build with sanitizers.
        "reactionless": {"to_q_rad": [0.05, *MOVE["from_q_rad"][1:]], "to_pose": {"directions": ["z"]},
                         "base": {"mass_kg": 100, "inertia_kg_m2": [9, 0, 0, 9, 0, 9]}, "particles": 8, "rounds": 1},
    }
    for master in masters:
        name = master["ID"]
        g.call("GET", "/work-masters/{name}", 200, {"name": name})
        jsonschema.Draft202012Validator.check_schema(master["RequestSchema"])
        jsonschema.Draft202012Validator.check_schema(master["ReplySchema"])
        plain = {**MOVE, "detail": "all", **special.get(name, {})}
        if name == "reach":
            plain = {"robot": "lwr4", "poses": [{"p_m": [0.4, 0.2, 0.6], "quaternion_wxyz": [1, 0, 0, 0]}]}
        elif name not in ("optimise", "grow", "cycle_time"):
            plain["T_s"] = 2
        needed = "poses" if name == "reach" else "to_q_rad"
        reply, header = g.call("POST", "/services/{name}", 200, {"name": name}, body=plain, fields={"Prefer": "wait=30"})
        own = jsonschema.Draft202012Validator(master["ReplySchema"])
        expect(own.is_valid(reply), name, "reply does not fit its own schema", [e.message for e in own.iter_errors(reply)][:2])
        expect(master["Immediate"] or header.getheader("Content-Location"), name, "has no Content-Location")
        g.call("POST", "/services/{name}", 200, {"name": name}, body={**plain, "service": name}, fields={"Prefer": "wait=30"})
        g.call("POST", "/services/{name}", 422, {"name": name}, body={**plain, "robot": "nobody"}, well_formed=True)
        g.call("POST", "/services/{name}", 422, {"name": name}, body={k: v for k, v in plain.items() if k != needed},
               well_formed="to_pose" in plain)  # which may be the goal by itself
        g.call("POST", "/services/{name}", 422, {"name": name}, body={**plain, "detail": "some"})
    feasibility = {"name": "feasibility"}
    from_run = {k: v for k, v in MOVE.items() if k != "from_q_rad"}
    g.call("POST", "/services/{name}", 200, feasibility, body={**from_run, "from": "run"})
    g.call("POST", "/services/{name}", 200, feasibility, body={**from_run, "from": "run", "from_signal": "drive.theta"})
    g.call("POST", "/services/{name}", 422, feasibility, body={**from_run, "from": "run", "from_signal": "drive.x"}, well_formed=True)
    g.call("POST", "/services/{name}", 404, {"name": "nobody"}, body={})
    # A short job may have ended before its answer is written, which is then 200.
    _, header = g.call("POST", "/services/{name}", 202, {"name": "optimise"}, body=LONG, fields={"Prefer": "respond-async"})
    job = {"id": header.getheader("Location").rpartition("/")[2]}
    g.call("POST", "/job-orders/{id}/commands", 202, job, body={"Command": "Abort"})
    ended(g, job["id"])
    g.call("DELETE", "/job-orders/{id}", 204, job)
    key = {"Idempotency-Key": "service-1"}
    _, header = g.call("POST", "/services/{name}", 200, {"name": "optimise"}, {"wait": "30"}, body={**SEARCH, "seed": 2}, fields=key)
    g.call("DELETE", "/job-orders/{id}", 204, {"id": header.getheader("Content-Location").rpartition("/")[2]})
    g.call("POST", "/services/{name}", 410, {"name": "optimise"}, body={**SEARCH, "seed": 2}, fields=key, well_formed=True)


def check_control(g):
    """Requests without a service, and chains."""
    move = {k: v for k, v in MOVE.items() if k != "from_q_rad"}
    reply, _ = g.call("POST", "/services", 200, body={**move, "goal": "fastest", "audience": "operator"})
    expect(set(reply) == {"verdict", "choice", "sentence", "light"} and reply["choice"]["row"] == "duration", "operator", reply)
    reply, _ = g.call("POST", "/services", 200, body={**MOVE, "goal": "cheapest", "audience": "planner", "deadline": "2099-01-01T00:00:00Z",
                                                      "particles": 16, "rounds": 5, "refine": False},
                      fields={"Prefer": "wait=30"})
    expect(reply["choice"]["service"] == "optimise" and reply["choice"]["in_time"] is True, "deadline", reply)
    g.call("POST", "/services", 422, body={**MOVE, "goal": "cheapest", "deadline": "2001-01-01T00:00:00Z"}, well_formed=True)
    g.call("POST", "/services", 422, body={**MOVE, "goal": "cheapest", "deadline": "soon"}, well_formed=True)
    chain = {"defaults": MOVE, "audience": "planner", "steps": [
        {"name": "shortest", "goal": "fastest"}, {"name": "cost", "goal": "cheapest", "T_s": "$shortest/T_s"}]}
    reply, _ = g.call("POST", "/services", 200, body=chain)
    expect([s["name"] for s in reply["steps"]] == ["shortest", "cost"], "chain", reply)
    for wrong_chain in ({**chain, "steps": []}, {**chain, "audience": "child"}, {**chain, "more": 1}):
        g.call("POST", "/services", 422, body=wrong_chain)
    for steps in (chain["steps"][::-1], [{"service": "nobody"}], [{**chain["steps"][0], "goal": "soon"}]):
        g.call("POST", "/services", 422, body={**chain, "steps": steps}, well_formed=True)
    key = {"Idempotency-Key": "control-1"}
    search = {k: v for k, v in SEARCH.items() if k not in MOVE}
    order_of_chain = {"defaults": MOVE, "steps": [chain["steps"][0], {**search, "T_min_s": "$shortest/T_s", "seed": 3}]}
    _, header = g.call("POST", "/services", 200, query={"wait": "30"}, body=order_of_chain, fields=key)
    job = {"id": header.getheader("Content-Location").rpartition("/")[2]}
    page, _ = g.call("GET", "/results", 200, query={"job": job["id"], "order": "oldest"})
    expect([r["Service"] for r in page["Results"]] == ["cycle_time", "optimise", "chain"], "results of a chain", page)
    found, _ = g.call("POST", "/results/find", 200, body=order_of_chain)
    expect([r["JobOrderID"] for r in found["Results"]] == [job["id"]], "results of an equal chain", found)
    g.call("DELETE", "/job-orders/{id}", 204, job)
    g.call("POST", "/services", 410, body=order_of_chain, fields=key, well_formed=True)
    long_chain = {"defaults": MOVE, "steps": [{k: v for k, v in LONG.items() if k not in MOVE}]}
    _, header = g.call("POST", "/services", 202, body=long_chain, fields={"Prefer": "respond-async"})
    job = {"id": header.getheader("Location").rpartition("/")[2]}
    g.call("POST", "/job-orders/{id}/commands", 202, job, body={"Command": "Abort"})
    ended(g, job["id"])
    g.call("POST", "/job-orders", 201, body=order(chain, "chain", WorkMasterID=[{"ID": "chain"}]))
    ended(g, "chain")


def check_jobs(g):
    g.call("GET", "/events", 200)
    web_socket_messages(g, "/events", "", 0)
    watch = events(g, "/events")
    g.call("POST", "/job-orders", 201, body=order(SEARCH, "a", Priority=3, Description=[{"Locale": "en", "Text": "first"}]))
    ended(g, "a")
    for name, data in watch:
        if name == "job" and data["JobOrderID"] == "a" and data["State"][0]["StateText"] == "Ended":
            break
    watch.close()
    for name, _ in events(g, "/events", fields={"Last-Event-ID": "999999"}):
        expect(name == "resync", "event", name)
        break
    key = {"Idempotency-Key": "key-1"}
    g.call("POST", "/job-orders", 201, body=order(SEARCH, "b"), fields=key)
    g.call("POST", "/job-orders", 200, body=order(SEARCH, "b"), fields=key)
    g.call("POST", "/job-orders", 409, body=order(SEARCH, "a"), well_formed=True)
    ended(g, "b")
    g.call("POST", "/job-orders/{id}/commands", 204, {"id": "b"}, body={"Command": "Clear", "Comment": [{"Text": "done"}]})
    g.call("POST", "/job-orders", 410, body=order(SEARCH, "b"), fields=key, well_formed=True)
    parameters = [
        {"ID": "Deadline", "Value": "2099-11-22T08:00:00Z"},
        {"ID": "TimeLimit", "Value": 60},
        {"ID": "Reuse", "Value": False},
    ]
    c = order(SEARCH, "c", WorkMasterID=[{"ID": "optimise"}], StartTime="2026-01-01T00:00:00Z", EndTime="2099-01-01T00:00:00+01:00")
    c["JobOrderParameters"] += parameters
    _, header = g.call("PUT", "/job-orders/{id}", 201, {"id": "c"}, {"start": "false"}, c, {"If-None-Match": "*"})
    g.call("PUT", "/job-orders/{id}", 200, {"id": "c"}, body=c, fields={"If-Match": header.getheader("ETag")})
    g.call("PUT", "/job-orders/{id}", 412, {"id": "c"}, body=c, fields={"If-Match": '"0"'}, well_formed=True)
    g.call("PUT", "/job-orders/{id}", 412, {"id": "c"}, body=c, fields={"If-None-Match": "*"}, well_formed=True)
    g.call("PUT", "/job-orders/{id}", 428, {"id": "c"}, body=c, well_formed=True)
    g.call("PUT", "/job-orders/{id}", 409, {"id": "a"}, body=order(SEARCH), fields={"If-Match": "*"}, well_formed=True)
    g.call("PUT", "/job-orders/{id}", 404, {"id": "nobody"}, body=order(SEARCH), fields={"If-Match": "*"}, well_formed=True)
    g.call("GET", "/job-orders/{id}", 200, {"id": "c"})
    g.call("POST", "/job-orders/{id}/commands", 409, {"id": "c"}, body={"Command": "Pause"}, well_formed=True)
    g.call("POST", "/job-orders/{id}/commands", 202, {"id": "c"}, body={"Command": "Start"})
    g.call("POST", "/job-orders/{id}/commands", 404, {"id": "nobody"}, body={"Command": "Start"}, well_formed=True)
    for body in ({"Command": "Explode"}, {}, {"Command": 1}, {"Command": "Start", "Comment": [{}]}):
        g.call("POST", "/job-orders/{id}/commands", 422, {"id": "c"}, body=body)
    ended(g, "c")
    for body in (
        {}, order({}), order({"service": "nobody"}), order(SEARCH, Priority=1e9), order(SEARCH, Priority=1.5), order(SEARCH, JobOrderID=""),
        order(SEARCH, JobOrderID="a b"), order(SEARCH, JobOrderID="a/b"), order(SEARCH, StartTime="soon"), order(SEARCH, Description="x"),
        order(SEARCH, WorkMasterID=[]), {"JobOrderParameters": parameters}, {"JobOrderParameters": [{"ID": "Request"}]},
        {"JobOrderParameters": order(SEARCH)["JobOrderParameters"] + [{"ID": "TimeLimit", "Value": 1e300}]},
        {"JobOrderParameters": order(SEARCH)["JobOrderParameters"] + [{"ID": "Colour", "Value": "red"}]},
    ):
        g.call("POST", "/job-orders", 422, body=body)
    g.call("POST", "/job-orders", 422, body=order(SEARCH, WorkMasterID=[{"ID": "energy"}]), well_formed=True)

    g.call("POST", "/job-orders", 201, body=order(LONG, "long"))
    while g.call("GET", "/job-orders/{id}", 200, {"id": "long"})[0]["State"][0]["StateText"] != "Running":
        time.sleep(0.01)
    g.call("DELETE", "/job-orders/{id}", 409, {"id": "long"})
    for command in ("Pause", "Resume", "Abort"):
        g.call("POST", "/job-orders/{id}/commands", 202, {"id": "long"}, body={"Command": command})
    ended(g, "long")
    g.call("DELETE", "/job-orders/{id}", 204, {"id": "long"})
    for method in ("GET", "DELETE"):
        g.call(method, "/job-orders/{id}", 404, {"id": "long"})
    g.call("GET", "/job-responses/{id}", 404, {"id": "long"})

    page, header = g.call("GET", "/job-orders", 200, query={"limit": "1", "order": "newest", "state": "Ended,Aborted", "robot": "lwr4"})
    expect(header.getheader("Link"), "a page has no Link")
    g.call("GET", "/job-orders", 200, query={"cursor": page["Next"], "order": "newest", "from": "2020-01-01T00:00:00Z"})
    for query in ({"limit": "0"}, {"limit": "x"}, {"cursor": "x"}, {"state": "Happy"}, {"order": "best"}, {"from": "soon"}):
        g.call("GET", "/job-orders", 400, query=query)
        if "state" not in query:
            g.call("GET", "/results", 400, query=query)
    page, _ = g.call("GET", "/results", 200, query={"service": "optimise", "job": "a", "order": "oldest"})
    number = str(page["Results"][0]["Number"])
    g.call("GET", "/results", 200, query={"request_hash": page["Results"][0]["RequestHash"], "before": "2099-01-01T00:00:00Z"})
    g.call("GET", "/results/{number}", 200, {"number": number})
    g.call("GET", "/results/{number}", 404, {"number": "999999"})
    g.call("GET", "/results/{number}", 404, {"number": "x"})
    found, _ = g.call("POST", "/results/find", 200, query={"limit": "5"}, body=dict(reversed(SEARCH.items())))
    expect(found["Results"], "no result of an equal request is found")
    g.call("POST", "/results/find", 422, body={k: v for k, v in SEARCH.items() if k != "service"})


def has_page(g):
    """Whether the program was built with node, which makes the page of a run."""
    return g.send("GET", "/run/page")[0] == 200


def check_run(g):
    if has_page(g):
        g.call("GET", "/run/page", 200)
    g.call("GET", "/run/signals", 200, query={"component": "drive"})
    g.call("GET", "/run/values", 200, query={"names": "drive.q,drive.B[2],gateway.requests"})
    g.call("GET", "/run/values", 400)
    g.call("GET", "/run/values", 422, query={"names": "drive.x"})
    values = lambda **query: "?" + urllib.parse.urlencode({"names": "drive.q,gateway.open", **query})
    seen = set()
    for name, _ in events(g, "/run/stream", values(rate_hz="100")):
        seen.add(name)
        if seen >= {"run", "sample"}:
            break
    for name, _ in events(g, "/run/stream", values(every="2")):
        if name == "samples":
            break
    web_socket_messages(g, "/run/stream", values(rate_hz="100"), 5)
    g.call("GET", "/run/stream", 200, query={"names": "drive.q", "rate_hz": "1", "every": "3"})
    for query in ({}, {"names": "drive.q", "rate_hz": "0"}, {"names": "drive.q", "every": "1.5"}, {"names": "drive.q", "every": "-1"}):
        g.call("GET", "/run/stream", 400, query=query)
    g.call("GET", "/run/stream", 422, query={"names": "drive.x"})
    put = ("PUT", "/run/tunables/{name}")
    g.call(*put, 200, {"name": "drive.B"}, body={"value": 1.5})
    g.call(*put, 200, {"name": "drive.B"}, body={"value": [1, 1, 1, 1, 1, 1, 1]})
    g.call(*put, 200, {"name": "drive.B[2]"}, body={"value": 2, "time_s": 1e5})
    g.call(*put, 404, {"name": "drive.x"}, body={"value": 1}, well_formed=True)
    g.call(*put, 409, {"name": "drive.B"}, body={"value": 1, "time_s": 0}, well_formed=True)
    for value in (-1, [1, 2]):
        g.call(*put, 422, {"name": "drive.B"}, body={"value": value}, well_formed=True)
    g.call(*put, 422, {"name": "drive.q"}, body={"value": 1}, well_formed=True)
    for body in ({"value": "1"}, {"value": []}, {"value": None}, {"value": [[1]]}, {"value": 1, "time_s": "0"}, {"value": [1] * 257}):
        g.call(*put, 422, {"name": "drive.B"}, body=body)
    post = ("POST", "/run/commands")
    for body in ({"command": "pause"}, {"command": "step", "ticks": 2}, {"command": "resume"},
                 {"command": "set", "values": {"drive.B[1]": 3, "drive.B[3]": 2}}):
        g.call(*post, 200, body=body)
    g.call(*post, 409, body={"command": "set", "values": {"drive.B": 3}, "time_s": 0}, well_formed=True)
    g.call(*post, 422, body={"command": "set", "values": {"drive.x": 3}}, well_formed=True)
    for body in ({}, {"command": "fly"}, {"command": 1}, {"command": "step"}, {"command": "step", "ticks": 0}, {"command": "step", "ticks": 1.5},
                 {"command": "step", "ticks": 1e300}, {"command": "pause", "ticks": 1}, {"command": "set"}, {"command": "set", "values": {}},
                 {"command": "set", "values": {"drive.B": "x"}}, {"command": "set", "values": [1]}):
        g.call(*post, 422, body=body)


def check_access(g, parts):
    """A gateway with tokens: routes, scopes, tokens, tickets."""
    later = concurrent.futures.ThreadPoolExecutor(32)  # wrong tokens are answered late
    for path, operations in g.document["paths"].items():
        for verb, operation in operations.items():
            method, part = verb.upper(), parts.get(path)
            body = b"{}" if "requestBody" in operation else None
            scopes = set() if (method, path) in OPEN else CHANGES.get((method, path), {"read"})
            expect(set(operation["x-scopes"]) == scopes, method, path, "is for", operation["x-scopes"])
            if not scopes:
                expect(not operation["security"], path, "security")
                g.call(method, path, 200, part, fields={"Authorization": ""})
                continue
            named = {scope for one in operation["security"] for scope in one.get("token", [])}
            expect(named == scopes, method, path, "security", named)
            for authorization in (None, "", "Bearer nonsense-nonsense", "Basic YTpi"):
                later.submit(g.call, method, path, 401, part, body=body, fields={"Authorization": authorization})
            for word in WORDS:
                token = {"Authorization": "Bearer 0123456789abcdef-" + word}
                if not scopes & {word, "read"}:
                    g.call(method, path, 403, part, body=body, fields=token)
                elif scopes != {"read"}:  # those who may are told what else is wrong
                    status, _, text = g.send(method, path.replace("{id}", "wrong").replace("{name}", "gateway.open"), body, token)
                    expect(status not in (401, 403) or "takes no commands" in text, method, path, word, "gave", status, text)
            if EVENTS not in operation["responses"].get("200", {}).get("content", {}):  # tickets are for streams
                ticket, _ = g.call("POST", "/tickets", 201, fields={"Authorization": "Bearer " + READ})
                g.call(method, path, 401, part, body=body, fields={"Authorization": None}, query={"ticket": ticket["ticket"]})
    later.shutdown()
    g.call("GET", "/run/page", 404)
    g.call("POST", "/services/{name}", 403, {"name": "optimise"}, body=SEARCH, fields={"Authorization": "Bearer " + READ}, well_formed=True)
    g.call("POST", "/services", 403, body=SEARCH, fields={"Authorization": "Bearer " + READ}, well_formed=True)
    g.call("POST", "/run/commands", 403, body={"command": "stop"}, well_formed=True)
    g.call("PUT", "/run/tunables/{name}", 403, {"name": "gateway.open"}, body={"value": 1}, well_formed=True)
    ticket, _ = g.call("POST", "/tickets", 201)
    for name, _ in events(g, "/run/stream", "?names=gateway.open&ticket=" + ticket["ticket"]):
        if name == "sample":
            break


def main():
    run, tokens, plain = (Gateway(int(port), token) for port, token in zip(sys.argv[1:4], (None, OPERATE, None)))
    parts = {
        "/robots/{name}": {"name": "lwr4"},
        "/work-masters/{name}": {"name": "feasibility"},
        "/services/{name}": {"name": "feasibility"},
        "/job-orders/{id}": {"id": "wrong"},
        "/job-orders/{id}/commands": {"id": "wrong"},
        "/job-responses/{id}": {"id": "wrong"},
        "/results/{number}": {"number": "1"},
        "/run/tunables/{name}": {"name": "drive.B"},
    }
    for g in (run, tokens, plain):
        check_document(g.document)
    wrong_calls(run, parts)
    check_services(run)
    check_control(run)
    check_jobs(run)
    check_run(run)
    check_access(tokens, parts)
    plain.call("POST", "/services/{name}", 501, {"name": "optimise"}, body=SEARCH, well_formed=True)
    plain.call("POST", "/services", 501, body={"steps": [SEARCH]}, well_formed=True)
    plain.call("POST", "/services/{name}", 200, {"name": "feasibility"}, body=MOVE)

    for path, operations in run.document["paths"].items():
        for verb, operation in operations.items():
            place = (verb.upper(), path)
            named = {int(status) for status in operation["responses"] if status != "default"} - ELSEWHERE
            if place in AFTER_THE_RUN:
                named.discard(409)
            if path == "/run/page" and not has_page(run):
                continue
            seen = run.covered.get(place, set()) | tokens.covered.get(place, set())
            expect(named <= seen, *place, "never gave", sorted(named - seen))
            expect(any(isinstance(s, int) and s < 400 for s in seen), *place, "was never answered well")
            messages = operation["responses"].get("200", {}).get("content", {}).get(EVENTS, {}).get("x-messages", {})
            missing = set(messages) - seen - {"heartbeat", "problem"}
            expect(not missing, *place, "never sent", missing)
    print(f"{sum(len(s) for s in run.covered.values()) + sum(len(s) for s in tokens.covered.values())} kinds of answers, {len(wrong)} wrong")


try:
    main()
finally:
    for line in wrong:
        print(line)
sys.exit(1 if wrong else 0)
