"""Training on trajectories that the server flies itself: pull groups, weigh them, acknowledge them.

    sparring serve &
    python examples/trajectories.py                     # plain Python
    python examples/trajectories.py --form msgpack      # pip install msgpack

A real trainer puts its policy behind the server's endpoint (`sparring serve --policy-url … --policy-tokens`), sets the policy
`chat`, learns from tokens, log-probabilities and advantages, and raises `version` once the endpoint has the new weights.
This one has no weights: a built-in policy flies, and what a step of GRPO would be given is counted.
"""

import argparse
import http.client
import json
import os
import statistics
import time
import urllib.error
import urllib.request

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


class Api:
    """The feed in JSON or MessagePack."""

    def __init__(self, url, form):
        self.url, self.accept, self.load = url, "application/json", json.loads
        if form == "msgpack":
            import msgpack

            self.accept, self.load = "application/msgpack", msgpack.unpackb

    def ask(self, method, path, body=None):
        """Asks, and again where the server is busy or away for a moment."""
        headers = {"Accept": self.accept, "Content-Type": "application/json", **TOKEN}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        for _ in range(60):
            try:
                with urllib.request.urlopen(request, timeout=120) as answer:
                    return self.load(answer.read())
            except urllib.error.HTTPError as refused:
                problem = self.load(refused.read())
                if refused.code not in (429, 503):
                    raise SystemExit(f"{method} {path}: {problem.get('field', '')} {problem['detail']}") from refused
                time.sleep(float(refused.headers.get("Retry-After", 1)))
            except (OSError, http.client.HTTPException):  # away for a moment: what was not acknowledged comes again
                time.sleep(1)
        raise SystemExit(f"{method} {path}: nobody answers")


def advantages(group):
    """Each episode's score against its siblings': what GRPO (Shao et al. 2024) learns from."""
    scores = [episode["score"] for episode in group["episodes"]]
    spread = statistics.pstdev(scores)
    return [(score - statistics.mean(scores)) / (spread + 1e-4) for score in scores]


def learn(group):
    """Where a trainer takes its step: every action with the advantage of its episode. How many were worth learning from."""
    worth = 0
    for episode, advantage in zip(group["episodes"], advantages(group)):
        assert episode["steps"][-1]["done"]
        worth += sum(step["action"] is not None and advantage != 0 for step in episode["steps"])
    return worth


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--url", default="http://127.0.0.1:8700")
    args.add_argument("--run", default=None, help="the id of the run that is made (one is made up)")
    args.add_argument("--policy", default="random", help="a built-in policy, or chat")
    args.add_argument("--groups", type=int, default=40)
    args.add_argument("--form", choices=["json", "msgpack"], default="json")
    args = args.parse_args()

    api = Api(args.url, args.form)
    wish = {"group_size": 8, "tasks": ["kessler/survival"]}
    run = api.ask("POST", "/v1/runs", wish | ({"id": args.run} if args.run else {}))["id"]
    api.ask("PUT", f"/v1/runs/{run}/policy", {"policy": args.policy, "version": 1, "ahead": 16})
    taken, worth = set(), 0
    while len(taken) < args.groups:
        pulled = api.ask("GET", f"/v1/runs/{run}/trajectories?limit={min(4, args.groups - len(taken))}&wait_s=30&ttl_s=300")
        for group in pulled["groups"]:
            # Delivered at least once: an id that was taken is not learnt from again.
            if group["id"] not in taken:
                taken.add(group["id"])
                worth += learn(group)
                scores = " ".join(f"{episode['score']:.3f}" for episode in group["episodes"])
                print(f"group {group['id']:4} {group['task']} L{group['level']} version {group['policy_version']}: {scores}")
        # Only what was learnt from is acknowledged: what a trainer that dies has not, comes again.
        api.ask("POST", f"/v1/runs/{run}/trajectories/ack", {"ids": [group["id"] for group in pulled["groups"]]})
    policy = api.ask("PUT", f"/v1/runs/{run}/policy", {"policy": "off"})
    assert policy["version"] == 1 and policy["failed"] == 0, policy
    print(f"{len(taken)} groups, {worth} actions worth learning from")


if __name__ == "__main__":
    main()
