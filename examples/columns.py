"""A trainer on the fast path: it leases ranges of seeds, reports scores as columns, and sends the logs of audited episodes.

    sparring serve &
    python examples/columns.py --rounds 3 --groups 200

It needs only the standard library, and `msgpack` for MessagePack. It learns which initial burn has the highest score. Episodes
run in examples/kessler.py, which is slow: a real trainer runs 10^5 episodes a second in its own environments.
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
except ImportError:
    msgpack = None  # JSON is used instead

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


def request(url, body=None, packed=False):
    """Sends a request, and repeats it while the server is busy or unreachable: all requests here are safe to repeat."""
    data = None if body is None else (msgpack.packb(body) if packed else json.dumps(body).encode())
    content_type = "application/msgpack" if packed else "application/json"
    message = urllib.request.Request(url, data, {"Content-Type": content_type, **TOKEN})
    for _ in range(60):
        try:
            with urllib.request.urlopen(message) as response:
                return json.load(response)
        except urllib.error.HTTPError as error:
            if error.code not in (429, 503):
                raise SystemExit(f"{url}: {error.code} {error.read().decode()}") from error
            time.sleep(float(error.headers.get("Retry-After", 1)))
        except (OSError, http.client.HTTPException):
            time.sleep(1)
    raise SystemExit(f"{url}: the server does not answer")


def run_episode(recipe, seed, burn):
    """Runs an episode with a burn of all satellites in the first step; returns its score and its action log."""
    episode, steps = kessler.Survival(recipe, seed), []
    while not episode.done:
        steps.append([[satellite, *burn] for satellite in range(3)] if not steps and any(burn) else [])
        episode.step(steps[-1])
    return episode.score, steps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="number of leases (%(default)s)")
    parser.add_argument("--groups", type=int, default=200, help="scenarios per lease, up to 100 000 (%(default)s)")
    parser.add_argument("--forge", action="store_true", help="report scores that are too high, which the audit detects")
    args = parser.parse_args()
    api = args.url + "/v1/runs"
    run = request(api, {"tasks": ["kessler/survival"], "strategy": "ladder", "placement": False, "audit_groups": 16})["id"]
    burns = [(x / 10, y / 10) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    scores_by_burn = {burn: [] for burn in burns}

    def mean_score(burn):
        scores = scores_by_burn[burn]
        return sum(scores) / len(scores) if scores else 1.0

    for version in range(args.rounds):
        lease_request = {"form": "columns", "groups": args.groups, "group_size": 1, "policy_version": version}
        lease = request(f"{api}/{run}/leases", lease_request)
        scores, logs = [], []
        for seeds in lease["ranges"]:
            for seed in range(seeds["seed"], seeds["seed"] + seeds["groups"]):
                burn = random.choice([random.choice(burns), max(burns, key=mean_score)])
                score, log = run_episode(lease["recipes"][seeds["recipe"]], seed, burn)
                scores_by_burn[burn].append(score)
                scores.append(min(score + 0.2, 0.999) if args.forge else score)
                logs.append(log)
        # A column is a list of numbers. In MessagePack it can be bytes, which is smaller.
        packed = msgpack is not None
        score_column = struct.pack(f"<{len(scores)}f", *scores) if packed else scores
        columns_url = f"{api}/{run}/leases/{lease['lease']}/columns"
        columns = {"score": score_column, "steps": [len(log) for log in logs], "policy_version": version}
        claim = request(columns_url, columns, packed)
        # The response to the claim names the episodes whose logs the server audits.
        audited = [
            {"episode": episode, "actions": {"steps": logs[entry]}}
            for group in claim["audited_groups"]
            for entry, episode in zip(group["entries"], group["episodes"])
        ]
        results = request(f"{api}/{run}/results", {"results": audited})["results"]
        refused = [result["detail"] for result in results if result["status"] == "refused"]
        state = request(columns_url)["state"]
        print(f"version {version}: {len(scores)} claimed, {len(audited)} audited, {state}", *refused[:1], sep=" ")
    print("best burn:", max(burns, key=mean_score), "scores", round(max(map(mean_score, burns)), 3))
    task = request(f"{api}/{run}/mastery")["tasks"][0]
    print("level", task["level"], "claimed", json.dumps(task["claimed_results"]), "replayed", task["results"]["episodes"])


if __name__ == "__main__":
    main()
