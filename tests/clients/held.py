"""Holds a server to its OpenAPI document with schemathesis.

    pip install schemathesis==4.32.5 msgpack==1.2.4
    python held.py --sparring target/release/sparring [--examples 20] [--seed 1]

Starts the server on a database and a token of its own, makes a run with leases, episodes and designs, and asks every operation
of the document, with real ids and made-up ones, in JSON and MessagePack. Exits 0 where all is as documented, else not: with each
fault and a curl that shows it, or with why it could not be tried.

Left out, with why:
- GET /v1/runs/{run}/events never ends, GET /v1/sessions, /ws, /ws/ui and /mcp become WebSockets: schemathesis can only ask
  and wait.
- negative_data_rejection of results, each of which is refused by itself in an answer of 200, and of JSON-RPC, whose errors are in
  the body.
- missing_required_header: the document has no required header.
- ignored_auth: tests/tests/system/access asks every operation as every role.
- use_after_free, ensure_resource_availability: what one test releases another may ask for.
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
LEFT_OUT = ["/v1/runs/{run}/events", "/v1/sessions", "/ws", "/ws/ui"]
ACCEPT = itertools.cycle(["*/*", "application/json", "application/msgpack", "application/x-ndjson, application/json;q=0.9"])
WAIT_S = 1  # the longest wait_s that is asked for

CONFIG = """
[checks]
missing_required_header.enabled = false
ignored_auth.enabled = false
use_after_free.enabled = false
ensure_resource_availability.enabled = false
# 503 is an answer where it is documented; where it is not, status_code_conformance says so.
not_a_server_error.expected-statuses = ["2xx", "3xx", "4xx", "503"]
# 422 is for what a schema cannot say: which tasks there are, what a cursor must be, which layouts can be flown.
positive_data_acceptance.expected-statuses = ["2xx", "3xx", "404", "409", "422", "429", "503"]

[[operations]]
include-name = "GET /mcp"
enabled = false

[[operations]]
include-name = "POST /mcp"
checks.negative_data_rejection.enabled = false

[[operations]]
include-name = "POST /v1/runs/{run}/results"
checks.negative_data_rejection.enabled = false

[generation]
with-security-parameters = false  # a made-up token is 401 everywhere, and nothing else is seen

[phases]
stateful.enabled = false  # real ids come from here; the document has no links
fuzzing.error-feedback.enabled = false  # it holds the server to what was guessed from its words, not to the document

[output]
sanitization.enabled = false  # max_tokens is no secret, and a curl must work
truncation.max-payload-size = 600

[dictionaries]
task.values = ["kessler/survival"]
few.values = [1, 2, 3]
soon.values = [0, 1]

[parameters]
"query.task" = { dictionary = "task", probability = 0.7 }
"query.limit" = { dictionary = "few", probability = 0.5 }
"query.wait_s" = { dictionary = "soon", probability = 0.9 }
"body.groups" = { dictionary = "few", probability = 0.8 }  # a lease of many takes long to prepare
"""
METHODS = ("get", "put", "post", "delete", "patch")
SPARE = ("pause", "archive", "policy", "policy_version", "retention")  # what ends with these would stop, age or forget what others need
JSON = "application/json"
made = {}  # what is real, by the name of its path parameter
real = itertools.count()
answers = collections.defaultdict(collections.Counter)  # operation: how often each status


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
    """The document describes a line."""
    return json.loads(response.content.splitlines()[0]) if response.content else None


@schemathesis.hook
def filter_failure(context, failure, case, response):
    """No line is as documented, too."""
    return response.content != b"" or "application/x-ndjson" not in response.headers.get("content-type", [])


@schemathesis.hook
def before_add_examples(context, examples):
    """What cannot be hit upon: bodies and queries that fit what there is."""
    for label, path, given in made["examples"]:
        if label == context.operation.label:
            given = {"query": given} if label.startswith("GET ") else {} if given is None else {"body": given, "media_type": JSON}
            examples.append(context.operation.Case(path_parameters=path, **given))


@schemathesis.hook
def before_call(context, case, kwargs):
    if case.path.startswith("/v1/"):
        case.headers.setdefault("Accept", next(ACCEPT))
    spare = case.path.rsplit("/", 1)[-1] in SPARE
    negative = case.meta and case.meta.is_negative_at(ParameterLocation.PATH)
    if case.meta and case.path_parameters and not negative and (turn := next(real)) % 5:  # of five, one stays as it was drawn
        for name in case.path_parameters:
            ids = ["spare"] if spare and name == "run" else made[name]
            case.path_parameters[name] = ids[turn % len(ids)]
    wait = (case.query or {}).get("wait_s")
    if isinstance(wait, int) and WAIT_S < wait <= 60:
        case.query["wait_s"] = WAIT_S


@schemathesis.hook
def after_call(context, case, response):
    answers[case.operation.label][response.status_code] += 1


def headers():
    return {"Content-Type": JSON, "Authorization": f"Bearer {made['token']}"}


def ask(url, method, path, body=None):
    """One request that must succeed; again while the server is not ready for it."""
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


def until(what, ready):
    """The first answer that is not empty."""
    for _ in range(120):
        if found := ready():
            return found
        time.sleep(0.5)
    raise SystemExit(f"no {what} after a minute")


def make(url):
    """Real things: a run that the server flies, leases of both forms with results, designs. Their ids by name."""
    for run in ("real", "spare"):
        ask(url, "POST", "/v1/runs", {"id": run, "seed": 1, "group_size": 2, "placement": False, "tasks": [TASK]})
    at = "/v1/runs/real"
    ask(url, "PUT", at + "/policy", {"policy": "random", "ahead": 64})  # it fails, so that there is something to design for
    leases = [ask(url, "POST", at + "/leases", {"groups": 2, "ttl_s": 86400}) for _ in range(2)]
    reported = leases[0]["groups"][0]["episodes"]
    ask(url, "POST", at + "/results", {"results": [{"episode": name, "actions": {"steps": [[]] * 50}} for name in reported]})
    columns = [ask(url, "POST", at + "/leases", {"form": "columns", "groups": 4, "group_size": 1, "ttl_s": 86400}) for _ in range(2)]
    ask(url, "POST", f"{at}/leases/{columns[0]['lease']}/columns", {"score": [0.5] * 4})
    until("trajectory", lambda: ask(url, "GET", at + "/trajectories?after=0&limit=1")["groups"])
    designs = until("design", lambda: ask(url, "GET", at + "/designs")["designs"])
    asked = ask(url, "POST", at + "/designs", {"n": 2})
    ask(url, "POST", f"{at}/designs/{designs[0]['id']}/retire")
    flown = ask(url, "GET", at + "/episodes?limit=4")["episodes"]
    ask(url, "POST", "/reset", {"task": "survival", "seed": 7})
    evaluations = [ask(url, "POST", "/v1/evaluations", {"policy": policy})["id"] for policy in ("hold", "heuristic")]
    for evaluation in evaluations:
        until("evaluation", lambda: ask(url, "GET", f"/v1/evaluations/{evaluation}")["state"] == "complete")
    given_up = ask(url, "POST", "/v1/evaluations", {"policy": "mine", "run": "real"})["id"]
    group, left = leases[0]["groups"][1], {"run": "real", "lease": columns[1]["lease"]}
    actions = {"steps": [[[0, 0.1, 0.0]]] + [[]] * 49}
    scenario = {"task": TASK, "seed": 7}
    return {
        "run": ["real"], "ask": [asked["id"]], "lease": [lease["lease"] for lease in leases + columns],
        "episode": reported + group["episodes"] + [episode["episode"] for episode in flown],
        "design": [design["id"] for design in designs[:4]], "layout": [design["id"] for design in designs[:4]],
        "evaluation": evaluations, "version": [1, 2, 3],
        "examples": [
            ("GET /v1/evaluations/compare", {}, {"a": evaluations[0], "b": evaluations[1]}),
            ("POST /v1/evaluations/{evaluation}/cancel", {"evaluation": given_up}, None),
            ("POST /step", {}, {"burns": []}),
            ("POST /v1/scenarios", {}, {"scenario": scenario}),
            ("POST /v1/scenarios", {}, {"scenario": scenario, "actions": actions, "telemetry": True}),
            ("POST /v1/runs/{run}/leases", {"run": "real"}, {"groups": 1}),
            ("POST /v1/runs/{run}/results", {"run": "real"}, {"results": [{"episode": group["episodes"][0], "actions": actions}]}),
            ("POST /v1/runs/{run}/results", {"run": "real"}, {"results": [{"episode": group["episodes"][1], "status": "failed"}]}),
            ("POST /v1/runs/{run}/leases/{lease}/renew", {"run": "real", "lease": leases[1]["lease"]}, None),
            ("POST /v1/runs/{run}/leases/{lease}/columns", left, {"score": [0.5] * 4, "failed": [0, 0, 0, 1]}),
        ],
    }


def serve(sparring, folder):
    """The server and its URL."""
    log, at = open(folder / "log", "w"), ["--db", folder / "held.sqlite3"]
    create = [sparring, "token", "create", "all", "--role", "admin", *at]
    made["token"] = subprocess.run(create, stdout=subprocess.PIPE, stderr=log, text=True, check=True).stdout.strip()
    often = ["--requests-each", "1000000", "--requests-anonymous", "1000000"]  # it asks as fast as it can
    server = subprocess.Popen([sparring, "serve", *at, *often, "--bind", "127.0.0.1:0"], stdout=log, stderr=log)
    said = lambda: re.search(r"serves at (http://\S+)", (folder / "log").read_text())
    return server, until("server", said)[1]


def hold(url, folder, args):
    """Schemathesis's exit code: 0, or 1 where it found something."""
    made.update(make(url))
    paths = ask(url, "GET", "/openapi.json")["paths"]
    made["operations"] = {f"{method.upper()} {path}" for path, item in paths.items() for method in item
                          if method in METHODS and path not in LEFT_OUT} - {"GET /mcp"}
    (folder / "schemathesis.toml").write_text(CONFIG)
    # One worker: Hypothesis reads the sources of lambdas, which CPython 3.11 does not bear in two threads at once
    # ("AST constructor recursion depth mismatch"); a second one saved no time.
    command = ["--config-file", str(folder / "schemathesis.toml"), "run", url + "/openapi.json",
               "--max-examples", str(args.examples), "--seed", str(args.seed), "--generation-database", "none",
               "--continue-on-failure", "--no-shrink", "--workers", "1", "--no-color",
               "--header", f"Authorization: Bearer {made['token']}", "--suppress-health-check", "all", "--request-timeout", "60", *args.more]
    for path in LEFT_OUT:
        command += ["--exclude-path", path]
    try:
        cli.main(command)
    except SystemExit as end:
        return end.code or 0
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="the server's binary")
    parser.add_argument("--examples", type=int, default=20, help="random cases of each operation and kind (20)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("more", nargs="*", help="more options for `schemathesis run`, after --")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        server, url = serve(args.sparring, folder)
        try:
            code = hold(url, folder, args)
            alive = server.poll() is None
        finally:
            server.terminate()
            server.wait()
        log = (folder / "log").read_text()
    never = [operation for operation in sorted(made["operations"]) if not any(200 <= status < 300 for status in answers[operation])]
    print(f"{sum(sum(statuses.values()) for statuses in answers.values())} requests to {len(answers)} operations")
    if never:
        print("never answered with success:", *(f"{operation} {dict(answers[operation])}" for operation in never), sep="\n  ")
    if not alive or "panicked" in log:
        print("the server fell:", log[-2000:], sep="\n")
    return 0 if code == 0 and alive and not never and "panicked" not in log else 1 if code in (0, 1) else 2


if __name__ == "__main__":
    sys.exit(main())
