"""A trainer on the fast path: leases ranges of seeds, flies them in its own process, claims how they went in columns, and hands in
the logs of what is audited.

    sparring serve &
    python examples/columns.py --rounds 3 --groups 200

Nothing but the standard library and, for MessagePack, `msgpack`. What it learns is which kick at the start pays best; what flies
is examples/kessler.py, which is slow: a real trainer flies 10^5 episodes a second in its own environments, and the rest is as here.
"""
import argparse
import http.client
import json
import os
import random
import struct
import time
import urllib.error
import urllib.request

import kessler

try:
    import msgpack
except ImportError:  # JSON will do
    msgpack = None

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


def call(url, body=None, packed=False):
    """A request, made again where the server is busy or away for a moment; what is wrong with it is told by the field at fault."""
    data = None if body is None else (msgpack.packb(body) if packed else json.dumps(body).encode())
    kind = "application/msgpack" if packed else "application/json"
    request = urllib.request.Request(url, data, {"Content-Type": kind, **TOKEN})
    for _ in range(60):
        try:
            with urllib.request.urlopen(request) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            if error.code not in (429, 503):
                raise SystemExit(f"{url}: {error.code} {error.read().decode()}") from error
            time.sleep(float(error.headers.get("Retry-After", 1)))
        except (OSError, http.client.HTTPException):  # the same again is answered as before
            time.sleep(1)
    raise SystemExit(f"{url}: nobody answers")


def fly(recipe, seed, kick):
    """One episode by a kick at the start: its score, and its log."""
    episode, steps = kessler.Survival(recipe, seed), []
    while not episode.done:
        steps.append([[satellite, *kick] for satellite in range(3)] if not steps and any(kick) else [])
        episode.step(steps[-1])
    return episode.score, steps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--groups", type=int, default=200, help="scenarios of a lease, up to 100 000")
    parser.add_argument("--forge", action="store_true", help="claim better scores than were flown, to see what becomes of it")
    args = parser.parse_args()
    api = args.url + "/v1/runs"
    run = call(api, {"tasks": ["kessler/survival"], "placement": False, "audit_groups": 16})["id"]
    kicks = [(x / 10, y / 10) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    earned = {kick: [] for kick in kicks}
    mean = lambda kick: sum(earned[kick]) / len(earned[kick]) if earned[kick] else 1.0
    for version in range(args.rounds):
        wish = {"form": "columns", "groups": args.groups, "group_size": 1, "policy_version": version}
        lease = call(f"{api}/{run}/leases", wish)
        scores, logs = [], []
        for block in lease["ranges"]:
            for seed in range(block["seed"], block["seed"] + block["groups"]):
                kick = random.choice([random.choice(kicks), max(kicks, key=mean)])
                score, log = fly(lease["recipes"][block["recipe"]], seed, kick)
                earned[kick].append(score)
                scores.append(min(score + 0.2, 0.999) if args.forge else score)
                logs.append(log)
        # A column is a list of numbers; in MessagePack it may be bytes, which costs less.
        packed = msgpack is not None
        column = struct.pack(f"<{len(scores)}f", *scores) if packed else scores
        steps = [len(log) for log in logs]
        columns = f"{api}/{run}/leases/{lease['lease']}/columns"
        claim = call(columns, {"score": column, "steps": steps, "policy_version": version}, packed)
        # Only now is it known whose logs are wanted.
        due = [
            {"episode": name, "actions": {"steps": logs[entry]}}
            for group in claim["audit"]
            for entry, name in zip(group["entries"], group["episodes"])
        ]
        told = call(f"{api}/{run}/results", {"results": due})["results"]
        refused = [result["detail"] for result in told if result["status"] == "refused"]
        state = call(columns)["state"]
        print(f"version {version}: {len(scores)} claimed, {len(due)} audited, {state}", *refused[:1], sep=" ")
    print("best kick:", max(kicks, key=mean), "earns", round(max(map(mean, kicks)), 3))
    task = call(f"{api}/{run}/mastery")["tasks"][0]
    print("level", task["level"], "claimed", json.dumps(task["claimed"]), "replayed", task["plain"]["episodes"])


if __name__ == "__main__":
    main()
