#!/usr/bin/env python3
"""A small client of a manufacturing execution system (MES), with Python's standard library alone: it asks the gateway of a robot twin
whether a move is possible, orders a better motion, watches the job, runs the chosen motion in the cell and compares the prediction with
the run. See README.md."""
import argparse
import csv
import json
import os
import re
import ssl
import subprocess
import sys
import urllib.error
import urllib.request

HERE = os.path.dirname(os.path.abspath(__file__))
ROBOT = "lwr4"
FROM, TO = [0, -0.9, 0, 1.2, 0, 0.6, 0], [1.2, 0.9, 0, -1.2, 0, -0.6, 0]  # rad
TABLE = {"scene": "table", "base": {"p_m": [0, 0, 0.3105]}, "self": True}  # what the robot stands on and must not meet, nor itself
PART = {"mass_kg": 3, "p_m": [0, 0, 0.15], "box_m": [0.08, 0.08, 0.08]}  # what it may carry, about a place of the flange
DURATION = 2.0  # s, that the takt of the cell leaves
SAMPLE = 0.002  # s, of the cell's recording


class Gateway:
    def __init__(self, url, token=None, certificate=None):
        self.url = url
        self.fields = {"Authorization": "Bearer " + token} if token else {}
        self.tls = ssl.create_default_context(cafile=certificate) if url.startswith("https:") else None

    def open(self, method, path, body=None, fields=None, timeout=60):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, data, {**self.fields, **(fields or {})}, method=method)
        if data is not None:
            request.add_header("Content-Type", "application/json")
        try:
            return urllib.request.urlopen(request, timeout=timeout, context=self.tls)
        except urllib.error.HTTPError as error:
            problem = json.load(error)
            sys.exit(f"{method} {path}: {error.code} {problem['title']}: {problem.get('pointer', '')} {problem.get('detail', '')}")

    def call(self, method, path, body=None, fields=None):
        with self.open(method, path, body, fields) as response:
            return json.load(response)


def events_of(stream):
    """Server-sent events as pairs of a name and its data."""
    name = data = ""
    with stream:
        for line in stream:
            key, _, value = line.decode().rstrip("\n").partition(": ")
            if key == "event":
                name = value
            elif key == "data":
                data += value
            elif not key:
                yield name, json.loads(data or "null")
                name = data = ""


def watch(gateway, job, events):
    """Prints the progress of a job until its end."""
    shown = -1
    for name, data in events:
        if name == "resync":  # events were lost: ask for the state instead
            data = gateway.call("GET", "/job-orders/" + job)
            data["JobOrderID"] = job
        elif name != "job" or data["JobOrderID"] != job:
            continue
        state = data["State"][0]["StateText"]
        tenth = int(10 * data["Progress"])
        if tenth > shown or state in ("Ended", "Aborted"):
            print(f"  job {job}: {state}, {100 * data['Progress']:.0f} %")
            shown = tenth
        if state in ("Ended", "Aborted"):
            return data["JobResult"]


def reply_of(response):
    values = {item["ID"]: item["Value"] for item in response["JobResponseData"]}
    if "Reply" not in values:
        sys.exit(f"no reply: {values.get('Problem') or values.get('ReasonForStateChange')}")
    return values["Reply"]


def run_cell(program, out, T, coefficients):
    """Runs the cell with a motion; returns ∫ Σ τ_J² dt, the largest |τ_J| per joint and the distance from the target at the end."""
    values = " ".join(repr(float(c)) for c in coefficients)
    subprocess.run([program, "run", os.path.join(HERE, "cell.ssd"), "--out", out, "--overwrite", "--quiet",
                    "--set", f"motion.T={T!r}", "--set", f"motion.c_r={values}", "--stop", repr(T)], check=True)
    with open(os.path.join(out, "signals.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    columns = [name for name in rows[0] if re.match(r"drive\.tau_J", name)]
    end = [name for name in rows[0] if re.match(r"drive\.q(\W|$)", name)]
    torque = [[float(row[name]) for name in columns] for row in rows]
    squares = [sum(tau * tau for tau in row) for row in torque]
    integral = SAMPLE * (sum(squares) - 0.5 * (squares[0] + squares[-1]))
    largest = [max(abs(row[j]) for row in torque) for j in range(len(columns))]
    miss = max(abs(float(rows[-1][name]) - target) for name, target in zip(end, TO))
    return integral, largest, miss


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("url", help="of the gateway, as `cotwin serve` prints it")
    options.add_argument("--program", default="cotwin", help="the program cotwin, which runs the cell")
    options.add_argument("--out", default="results/mes", help="folder for the results of the cell")
    options.add_argument("--token-file", help="file with a token")
    options.add_argument("--certificate", help="certificate of the gateway or of its authority, PEM")
    options.add_argument("--particles", type=int, default=48)
    options.add_argument("--rounds", type=int, default=60)
    a = options.parse_args()
    token = open(a.token_file).read().split()[-1] if a.token_file else None
    gateway = Gateway(a.url, token, a.certificate)

    print("1. who is there:", gateway.call("GET", "/health")["version"], "with robots", ", ".join(gateway.call("GET", "/robots")["robots"]))
    move = {"robot": ROBOT, "from_q_rad": FROM, "to_q_rad": TO}
    shortest = gateway.call("POST", "/services/feasibility", move)
    print(f"2. ask: the shortest quintic takes {shortest['T_s']:.3f} s; {DURATION} s are left")
    asked = gateway.call("POST", "/services/feasibility", {**move, "T_s": DURATION, "clear_of": TABLE})
    if not asked["feasible"]:
        sys.exit("the quintic is not possible in this time: " + asked["reason"])

    asked = gateway.call("POST", "/services/feasibility", {**move, "T_s": DURATION, "payload": PART, "clear_of": TABLE})
    if not asked["feasible"]:
        sys.exit("the quintic is not possible with the part: " + asked["reason"])
    most = gateway.call("POST", "/services/payload", {**move, "T_s": DURATION, "com_m": PART["p_m"]})
    print(f"   it may carry the part of {PART['mass_kg']} kg; the largest one is {most['mass_kg']:.2f} kg, by the torque of {most['limiting']['joint']}")

    # Without naming a service: how fast, and what does that cost? The same two steps for an operator and for a planner.
    with open(os.path.join(HERE, "order.json")) as file:
        question = json.load(file)
    told = {}
    for audience in ("operator", "planner"):
        request = {**question, "audience": audience}
        stored = gateway.call("POST", "/job-orders", {"JobOrderParameters": [{"ID": "Request", "Value": request}]})
        told[audience] = reply_of(gateway.call("GET", f"/job-responses/{stored['JobOrder']['JobOrderID']}?wait=30"))
    print(f"   to the operator ({told['operator']['light']}): {told['operator']['sentence']}")
    for step in told["planner"]["steps"]:
        figures = ", ".join(f"{figure['name']} {figure['text']}" for figure in step["reply"]["figures"])
        print(f"   to the planner, {step['service']} ({step['reply']['choice']['row']}): {figures}")

    request = {"service": "optimise", **move, "T_min_s": DURATION, "degree": 9, "cost": "torque", "drives": "none", "particles": a.particles, "rounds": a.rounds}
    order = {"JobOrderID": f"better-{os.getpid()}", "Priority": 5, "Description": [{"Locale": "en", "Text": "cheaper motion of cell 12"}],
             "JobOrderParameters": [{"ID": "Request", "Value": request}]}
    print("3. order a better motion")
    stream = gateway.open("GET", "/events", timeout=120)  # before the order, so that no event is missed
    stored = gateway.call("POST", "/job-orders", order, {"Idempotency-Key": order["JobOrderID"]})
    again = gateway.call("POST", "/job-orders", order, {"Idempotency-Key": order["JobOrderID"]})
    assert again["JobOrder"]["JobOrderID"] == stored["JobOrder"]["JobOrderID"], "an order that is sent twice is one job"
    job = stored["JobOrder"]["JobOrderID"]
    watch(gateway, job, events_of(stream))
    better = reply_of(gateway.call("GET", f"/job-responses/{job}"))
    coefficients = better["motion"]["c_r_rad"] if "motion" in better else better["c_r_rad"]
    T = better["T_s"]
    asked = gateway.call("POST", "/services/feasibility", {**move, "T_s": T, "degree": 9, "c_r_rad": coefficients, "drives": "none", "clear_of": TABLE})
    if not asked["clear_of"]["clear"]:
        sys.exit("the better motion is not clear: " + asked["reason"])
    nearest = asked["clear_of"]["nearest"]
    print(f"   it keeps clear of the table: {nearest['link']} comes nearest, {nearest['distance_m']:.3f} m")
    kept = gateway.call("POST", "/results/find", request)["Results"]
    print(f"4. choose: {better['status']}, predicted ∫Στ² dt = {better['cost']:.1f} N²m²s; the result is kept as number {kept[0]['Number']}")

    print("5. run both in the cell: flexible joints, friction, a controller")
    quintic, _, _ = run_cell(a.program, os.path.join(a.out, "quintic"), T, [0.0] * len(coefficients))
    cheaper, largest, miss = run_cell(a.program, os.path.join(a.out, "cheaper"), T, coefficients)
    report = {"predicted": better["cost"], "run": cheaper, "quintic": quintic, "saved_share": 1 - cheaper / quintic,
              "prediction_error": abs(cheaper / better["cost"] - 1), "miss_rad": miss, "largest_payload_kg": most["mass_kg"], "largest_torque_Nm": largest, "job": job, "told": told}
    print(f"6. compare: run {cheaper:.1f} N²m²s, predicted {better['cost']:.1f} ({100 * report['prediction_error']:.1f} % apart); the quintic "
          f"needs {quintic:.1f}, so {100 * report['saved_share']:.1f} % are saved; the robot ends {1e3 * miss:.2f} mrad from its target")
    with open(os.path.join(a.out, "report.json"), "w") as file:
        json.dump(report, file)


if __name__ == "__main__":
    main()
