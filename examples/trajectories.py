"""A trainer on rollouts of the server: it pulls groups of trajectories, computes advantages, and acknowledges the groups.

    sparring serve &
    python examples/trajectories.py                     # plain Python
    python examples/trajectories.py --form msgpack      # pip install msgpack

A real trainer serves its policy at an endpoint (`sparring serve --policy-url … --policy-tokens`) and sets the policy `chat`. It
learns from tokens, log-probabilities and advantages, and increments `version` once the endpoint has the new weights. This one has
no weights: a built-in policy acts, and the trainer counts the actions that a step of GRPO would use.
"""

import argparse
import http.client
import json
import os
import statistics
import time
import urllib.error
import urllib.request

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


class Api:
    """The API in JSON or MessagePack. Requests are repeated while the server is busy or unreachable."""

    def __init__(self, url, form):
        self.url, self.accept, self.decode = url, "application/json", json.loads
        if form == "msgpack":
            import msgpack

            self.accept, self.decode = "application/msgpack", msgpack.unpackb

    def request(self, method, path, body=None):
        headers = {"Accept": self.accept, "Content-Type": "application/json", **TOKEN}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        for _ in range(60):
            try:
                with urllib.request.urlopen(request, timeout=120) as response:
                    return self.decode(response.read())
            except urllib.error.HTTPError as error:
                problem = self.decode(error.read())
                if error.code not in (429, 503):
                    raise SystemExit(f"{method} {path}: {problem.get('field', '')} {problem['detail']}") from error
                time.sleep(float(error.headers.get("Retry-After", 1)))
            except (OSError, http.client.HTTPException):  # groups without acknowledgement are delivered again
                time.sleep(1)
        raise SystemExit(f"{method} {path}: the server does not answer")


def advantages(group):
    """Returns the score of each episode, normalised within its group, as in GRPO (Shao et al. 2024)."""
    scores = [episode["score"] for episode in group["episodes"]]
    deviation = statistics.pstdev(scores)
    return [(score - statistics.mean(scores)) / (deviation + 1e-4) for score in scores]


def learn(group):
    """Placeholder of a trainer's update; returns the number of actions with an advantage."""
    useful = 0
    for episode, advantage in zip(group["episodes"], advantages(group)):
        assert episode["steps"][-1]["done"]
        useful += sum(step["action"] is not None and advantage != 0 for step in episode["steps"])
    return useful


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--run", default=None, help="id of the run to create (default: chosen by the server)")
    parser.add_argument("--policy", default="random", help="a built-in policy, or chat (%(default)s)")
    parser.add_argument("--groups", type=int, default=40, help="number of groups to pull (%(default)s)")
    parser.add_argument("--form", choices=["json", "msgpack"], default="json", help="encoding of responses (%(default)s)")
    args = parser.parse_args()

    api = Api(args.url, args.form)
    settings = {"group_size": 8, "tasks": ["kessler/survival"], **({"id": args.run} if args.run else {})}
    run = api.request("POST", "/v1/runs", settings)["id"]
    api.request("PUT", f"/v1/runs/{run}/policy", {"policy": args.policy, "version": 1, "max_unacknowledged_groups": 16})
    learned, useful = set(), 0
    while len(learned) < args.groups:
        limit = min(4, args.groups - len(learned))
        claim = {"limit": limit, "wait_s": 30, "ttl_s": 300}
        pulled = api.request("POST", f"/v1/runs/{run}/trajectories/claim", claim)
        for group in pulled["groups"]:
            # A group can be delivered more than once.
            if group["id"] not in learned:
                learned.add(group["id"])
                useful += learn(group)
                scores = " ".join(f"{episode['score']:.3f}" for episode in group["episodes"])
                name = f"group {group['id']:4} {group['task']} L{group['level']} version {group['policy_version']}"
                print(f"{name}: {scores}")
        # Groups that are not acknowledged, as after a crash of the trainer, are delivered again.
        ids = [group["id"] for group in pulled["groups"]]
        api.request("POST", f"/v1/runs/{run}/trajectories/ack", {"ids": ids})
    policy = api.request("PUT", f"/v1/runs/{run}/policy", {"policy": "off"})
    assert policy["version"] == 1 and policy["failed"] == 0, policy
    print(f"{len(learned)} groups, {useful} actions with an advantage")


if __name__ == "__main__":
    main()
