"""Checks with schemathesis that a server conforms to its OpenAPI document.

    pip install schemathesis==4.32.5 msgpack==1.2.4
    python openapi_conformance.py --sparring target/release/sparring [--examples 20] [--seed 1]

Starts the server with a temporary database and a token, creates a run with leases, episodes and designs, and calls every
operation of the document with existing and made-up ids, in JSON and MessagePack. Exits with 0 if every response is as
documented. Otherwise it prints each fault with a curl command, or the reason why the check could not run.

Excluded is GET /v1/runs/{run}/events alone: an event stream never ends, and schemathesis waits for the end of a response.

Expected beside the document, with the reason:
- An invalid result is rejected by its receipt in a response of 200, and an invalid JSON-RPC request by an error in the body.
- GET of a WebSocket's path without an upgrade gets 405 or 426.
"""
import argparse
import collections
import itertools
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

import msgpack
import schemathesis
from schemathesis.cli import schemathesis as cli
from schemathesis.core.parameters import ParameterLocation

TASK = "kessler/survival"
EXCLUDED_PATHS = ["/v1/runs/{run}/events"]
ACCEPT_HEADERS = itertools.cycle(["*/*", "application/json", "application/msgpack", "application/x-ndjson, application/json;q=0.9"])
MAX_WAIT_S = 1  # limit of the query parameter wait_s

CONFIG = """
[checks]
# 503 is allowed where it is documented; status_code_conformance reports it elsewhere.
not_a_server_error.expected-statuses = ["2xx", "3xx", "4xx", "503"]
# 422 covers what a schema cannot express: known tasks, valid cursors, solvable layouts.
positive_data_acceptance.expected-statuses = ["2xx", "3xx", "404", "409", "422", "429", "503"]

[[operations]]
include-name = "GET /mcp"
checks.positive_data_acceptance.expected-statuses = ["405"]

[[operations]]
include-name = "GET /v1/sessions"
checks.positive_data_acceptance.expected-statuses = ["426"]

[[operations]]
include-name = "GET /v1/runs/{run}/sessions"
checks.positive_data_acceptance.expected-statuses = ["404", "426"]

[[operations]]
include-name = "POST /mcp"
checks.negative_data_rejection.expected-statuses = ["200", "4xx"]

[[operations]]
include-name = "POST /v1/runs/{run}/results"
checks.negative_data_rejection.expected-statuses = ["200", "4xx"]

[generation]
with-security-parameters = false  # a made-up token always gives 401 and tests nothing else

[phases]
stateful.enabled = false  # this script supplies existing ids; the document has no links
fuzzing.error-feedback.enabled = false  # it would test guesses from error messages instead of the document

[output]
sanitization.enabled = false  # max_tokens is no secret, and the curl commands must work
truncation.max-payload-size = 600

[dictionaries]
task.values = ["kessler/survival"]
few.values = [1, 2, 3]
soon.values = [0, 1]

[parameters]
"query.task" = { dictionary = "task", probability = 0.7 }
"query.limit" = { dictionary = "few", probability = 0.5 }
"query.wait_s" = { dictionary = "soon", probability = 0.9 }
"body.groups" = { dictionary = "few", probability = 0.8 }  # large leases take long to prepare
"""
SWITCHING = {"GET /v1/sessions", "GET /v1/runs/{run}/sessions", "GET /ws", "GET /ws/ui", "GET /mcp", "GET /harness"}  # these answer 101 to the upgrade of a WebSocket only
HTTP_METHODS = ("get", "put", "post", "delete", "patch")
SPARE_RUN_SUFFIXES = ("pause", "archive", "policy", "policy_version", "retention")  # these operations would break the run that other cases use
JSON_TYPE = "application/json"
resources = {}  # existing ids by the name of the path parameter, and further data for the hooks
path_id_counter = itertools.count()
status_counts = collections.defaultdict(collections.Counter)  # number of responses by operation and status


@schemathesis.serializer("application/msgpack")
def pack(context, value):
    try:
        return msgpack.packb(value)
    except OverflowError:  # MessagePack's integers end at 64 bits
        return msgpack.packb(json.loads(json.dumps(value), parse_int=lambda text: int(text) if len(text) < 19 else float(text)))


@schemathesis.deserializer("application/msgpack")
def unpack(context, response):
    return msgpack.unpackb(response.content)


@schemathesis.deserializer("application/x-ndjson")
def first_line(context, response):
    """Decodes the first line: the document describes one line."""
    return json.loads(response.content.splitlines()[0]) if response.content else None


@schemathesis.hook
def filter_failure(context, failure, case, response):
    """Ignores failures of empty NDJSON responses, which are valid."""
    return response.content != b"" or "application/x-ndjson" not in response.headers.get("content-type", [])


@schemathesis.hook
def before_add_examples(context, examples):
    """Adds bodies and queries that refer to existing resources, which random generation would not find."""
    for label, path, given in resources["examples"]:
        if label == context.operation.label:
            if label == "DELETE /mcp":
                given = {"headers": given}
            else:
                given = {"query": given} if label.startswith(("GET ", "DELETE ")) else {} if given is None else {"body": given, "media_type": JSON_TYPE}
            examples.append(context.operation.Case(path_parameters=path, **given))


@schemathesis.hook
def before_call(context, case, kwargs):
    if case.path.startswith("/v1/"):
        case.headers.setdefault("Accept", next(ACCEPT_HEADERS))
    spare = case.path.rsplit("/", 1)[-1] in SPARE_RUN_SUFFIXES
    negative = case.meta and case.meta.is_negative_at(ParameterLocation.PATH)
    if case.meta and case.path_parameters and not negative and (turn := next(path_id_counter)) % 5:  # one case in five keeps its random id
        for name in case.path_parameters:
            ids = ["spare"] if spare and name == "run" else resources[name]
            case.path_parameters[name] = ids[turn % len(ids)]
    if spare and (case.path_parameters or {}).get("run") == "real":  # a generated id, which responses may have suggested
        case.path_parameters["run"] = "spare"
    wait = (case.query or {}).get("wait_s")
    if isinstance(wait, int) and MAX_WAIT_S < wait <= 60:
        case.query["wait_s"] = MAX_WAIT_S


@schemathesis.hook
def after_call(context, case, response):
    status_counts[case.operation.label][response.status_code] += 1


def headers():
    return {"Content-Type": JSON_TYPE, "Authorization": f"Bearer {resources['token']}"}


def request_json(url, method, path, body=None):
    """Sends a request that must succeed; retries for a minute while the server returns 429 or 503."""
    data = None if body is None else json.dumps(body).encode()
    for _ in range(60):
        request = urllib.request.Request(url + path, data, headers(), method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as refused:
            if refused.code not in (429, 503):
                raise SystemExit(f"{method} {path}: {refused.read().decode()}") from refused
            time.sleep(1)
    raise SystemExit(f"{method} {path}: not ready after a minute")


def wait_for(what, ready):
    """Polls `ready` for a minute and returns its first non-empty value."""
    for _ in range(120):
        if found := ready():
            return found
        time.sleep(0.5)
    raise SystemExit(f"no {what} after a minute")


def create_resources(url):
    """Creates a run with server rollouts, leases of both forms with results, and designs; returns their ids."""
    for run in ("real", "spare", "unwanted", "finished"):
        request_json(url, "POST", "/v1/runs", {"id": run, "strategy": "ladder", "seed": 1, "group_size": 2, "placement": False, "tasks": [TASK]})
    request_json(url, "POST", "/v1/runs/unwanted/archive")
    at = "/v1/runs/real"
    request_json(url, "PUT", at + "/policy", {"policy": "random", "max_unacknowledged_groups": 64})  # the random policy fails, so that the designer has failures to aim at
    leases = [request_json(url, "POST", at + "/leases", {"groups": 2, "ttl_s": 86400}) for _ in range(2)]
    leases.append(request_json(url, "POST", at + "/leases", {"groups": 2, "ttl_s": 86400, "disclosure": "begin"}))
    reported = leases[0]["groups"][0]["episodes"]
    request_json(url, "POST", at + "/results", {"results": [{"episode": name, "actions": {"steps": [[]] * 50}} for name in reported]})
    columns = [request_json(url, "POST", at + "/leases", {"form": "columns", "groups": 4, "group_size": 1, "ttl_s": 86400}) for _ in range(2)]
    request_json(url, "POST", f"{at}/leases/{columns[0]['lease']}/columns", {"score": [0.5] * 4})
    wait_for("trajectory", lambda: request_json(url, "GET", at + "/trajectories?after=0&limit=1")["groups"])
    designs = wait_for("design", lambda: request_json(url, "GET", at + "/designs")["designs"])
    asked = request_json(url, "POST", at + "/designs", {"count": 2})
    request_json(url, "POST", f"{at}/designs/{designs[0]['id']}/retire")
    flown = request_json(url, "GET", at + "/episodes?limit=4")["episodes"]
    request_json(url, "POST", "/reset", {"task": "survival", "seed": 7})
    evaluations = [request_json(url, "POST", "/v1/evaluations", {"policy": policy})["id"] for policy in ("hold", "heuristic")]
    for evaluation in evaluations:
        wait_for("evaluation", lambda: request_json(url, "GET", f"/v1/evaluations/{evaluation}")["state"] == "complete")
    session = request_json(url, "POST", "/mcp", {"jsonrpc": "2.0", "id": 1, "method": "openenv/session/create"})["result"]["session_id"]
    split = {"split": request_json(url, "GET", "/sparring/splits")[0]["name"]}
    given_up = request_json(url, "POST", "/v1/evaluations", {"policy": "mine", "run": "real"})["id"]
    group, left = leases[0]["groups"][1], {"run": "real", "lease": columns[1]["lease"]}
    actions = {"steps": [[[0, 0.1, 0.0]]] + [[]] * 49}
    scenario = {"task": TASK, "seed": 7}
    return {
        "run": ["real"], "request": [asked["id"]], "lease": [lease["lease"] for lease in leases + columns],
        "episode": reported + group["episodes"] + [episode["episode"] for episode in flown],
        "design": [design["id"] for design in designs[:4]], "layout": [design["id"] for design in designs[:4]],
        "evaluation": evaluations, "version": [1, 2, 3],
        "examples": [
            ("GET /v1/evaluations/compare", {}, {"a": evaluations[0], "b": evaluations[1]}),
            ("POST /v1/evaluations/{evaluation}/cancel", {"evaluation": given_up}, None),
            ("DELETE /v1/runs/{run}", {"run": "unwanted"}, {"name": "unwanted"}),
            ("POST /v1/archive", {}, {"runs": ["finished"]}),
            ("POST /step", {}, {"burns": []}),
            ("POST /sparring/tasks", {}, split),
            ("POST /sparring/num_tasks", {}, split),
            ("POST /sparring/task", {}, {**split, "index": 0}),
            ("POST /sparring/task_range", {}, {**split, "start": 0, "stop": 2}),
            ("DELETE /mcp", {}, {"Mcp-Session-Id": session}),
            ("POST /v1/scenarios", {}, {"scenario": scenario}),
            ("POST /v1/scenarios", {}, {"scenario": scenario, "actions": actions, "telemetry": True}),
            ("POST /v1/runs/{run}/leases", {"run": "real"}, {"groups": 1}),
            ("POST /v1/runs/{run}/results", {"run": "real"}, {"results": [{"episode": group["episodes"][0], "actions": actions}]}),
            ("POST /v1/runs/{run}/results", {"run": "real"}, {"results": [{"episode": group["episodes"][1], "status": "failed"}]}),
            ("POST /v1/runs/{run}/leases/{lease}/renew", {"run": "real", "lease": leases[1]["lease"]}, None),
            ("POST /v1/runs/{run}/leases/{lease}/groups/begin", {"run": "real", "lease": leases[2]["lease"]}, {"groups": [0]}),
            ("POST /v1/runs/{run}/leases/{lease}/columns", left, {"score": [0.5] * 4, "failed": [0, 0, 0, 1]}),
        ],
    }


def serve(sparring, folder):
    """Starts the server; returns the process and its URL."""
    log, at = open(folder / "log", "w"), ["--db", folder / "conformance.sqlite3"]
    create = [sparring, "token", "create", "all", "--role", "admin", *at]
    resources["token"] = subprocess.run(create, stdout=subprocess.PIPE, stderr=log, text=True, check=True).stdout.strip()
    often = ["--requests-each", "1000000", "--requests-anonymous", "1000000"]  # schemathesis sends requests as fast as it can
    server = subprocess.Popen([sparring, "serve", *at, *often, "--bind", "127.0.0.1:0"], stdout=log, stderr=log)
    match_url = lambda: re.search(r"serves at (http://\S+)", (folder / "log").read_text())
    return server, wait_for("server", match_url)[1]


def run_schemathesis(url, folder, args):
    """Runs schemathesis and returns its exit code: 0, or 1 if it found a fault."""
    resources.update(create_resources(url))
    paths = request_json(url, "GET", "/openapi.json")["paths"]
    resources["operations"] = {f"{method.upper()} {path}" for path, item in paths.items() for method in item
                          if method in HTTP_METHODS and path not in EXCLUDED_PATHS} - SWITCHING
    (folder / "schemathesis.toml").write_text(CONFIG)
    # One worker: Hypothesis parses the source of lambdas, and CPython 3.11 fails if two threads do so at once
    # ("AST constructor recursion depth mismatch"). A second worker saved no time.
    command = ["--config-file", str(folder / "schemathesis.toml"), "run", url + "/openapi.json",
               "--max-examples", str(args.examples), "--seed", str(args.seed), "--generation-database", "none",
               "--continue-on-failure", "--no-shrink", "--workers", "1", "--no-color",
               "--header", f"Authorization: Bearer {resources['token']}", "--suppress-health-check", "all", "--request-timeout", "60", *args.more]
    for path in EXCLUDED_PATHS:
        command += ["--exclude-path", path]
    try:
        cli.main(command)
    except SystemExit as end:
        return end.code or 0
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="path of the sparring binary")
    parser.add_argument("--examples", type=int, default=20, help="random cases of each operation and phase (default 20)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("more", nargs="*", help="further options of `schemathesis run`, after --")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        server, url = serve(args.sparring, folder)
        try:
            code = run_schemathesis(url, folder, args)
            is_running = server.poll() is None
        finally:
            server.terminate()
            server.wait()
        log = (folder / "log").read_text()
    never_succeeded = [operation for operation in sorted(resources["operations"]) if not any(200 <= status < 300 for status in status_counts[operation])]
    print(f"{sum(sum(statuses.values()) for statuses in status_counts.values())} requests to {len(status_counts)} operations")
    if never_succeeded:
        print("no successful response:", *(f"{operation} {dict(status_counts[operation])}" for operation in never_succeeded), sep="\n  ")
    if not is_running or "panicked" in log:
        print("the server crashed:", log[-2000:], sep="\n")
    return 0 if code == 0 and is_running and not never_succeeded and "panicked" not in log else 1 if code in (0, 1) else 2


if __name__ == "__main__":
    sys.exit(main())
