"""A trainer on groups: it leases scenarios, runs each several times, reports every action, and learns from relative scores.

    sparring serve &
    python examples/groups.py --rounds 10

It needs only the standard library. It learns two numbers: the distance of debris at which a satellite burns, and the strength of
the burn. Both move along the variations with the better scores (evolution strategies, Salimans et al. 2017), weighted by the
group-relative advantages of GRPO (Shao et al. 2024).
"""

import argparse
import http.client
import itertools
import json
import math
import os
import random
import statistics
import time
import urllib.error
import urllib.request

import kessler

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}
# Results per request.
BATCH = 100
# Steps over which close approaches are predicted.
LOOK_AHEAD = 5
# Standard deviation of variations, and learning rate, in the logarithm of the policy's numbers.
SIGMA, LEARNING_RATE = 0.4, 1.0


class Api:
    """The API of runs. Requests are repeated while the server is busy or unreachable: all are safe to repeat here."""

    def __init__(self, url):
        self.url = url + "/v1/runs"

    def request(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        for _ in range(60):
            headers = {"Content-Type": "application/json", **TOKEN}
            request = urllib.request.Request(self.url + path, data, headers, method=method)
            try:
                with urllib.request.urlopen(request, timeout=60) as response:
                    return json.load(response)
            except urllib.error.HTTPError as error:
                problem = json.load(error)
                if error.code not in (429, 503):
                    raise SystemExit(f"{method} {path}: {problem.get('field', '')} {problem['detail']}") from error
                time.sleep(float(error.headers.get("Retry-After", 1)))
            except (OSError, http.client.HTTPException):
                time.sleep(1)
        raise SystemExit(f"{method} {path}: the server does not answer")


def predict_path(body):
    """Returns the states of a body in free flight over the next steps."""
    states = itertools.accumulate(itertools.repeat(body), lambda state, _: kessler.coast(state))
    return list(itertools.islice(states, 1, LOOK_AHEAD + 1))


def choose_burns(episode, distance, strength):
    """Yields a burn for each satellite that debris approaches within `distance` LU."""
    debris = [predict_path(body) for body in episode.debris]
    for satellite, body in enumerate(episode.satellites):
        if not episode.active[satellite]:
            continue
        path = predict_path(body)
        approaches = ((math.dist(own[:2], at[:2]), own, at) for others in debris for own, at in zip(path, others))
        nearest, own, at = min(approaches, default=(math.inf, None, None))
        if nearest < distance:  # a burn along the velocity, forwards or backwards, changes the later position
            gap = (own[0] - at[0]) * body[2] + (own[1] - at[1]) * body[3]
            factor = math.copysign(strength / math.hypot(*body[2:]), gap)
            yield [satellite, factor * body[2], factor * body[3]]


def run_episode(recipe, seed, policy):
    """Runs an episode; returns its action log."""
    episode, steps = kessler.Survival(recipe, seed), []
    while not episode.done:
        steps.append(list(choose_burns(episode, *policy)))
        episode.step(steps[-1])
    return steps


def advantages(scores):
    """Returns the group-relative advantages: scores minus their mean, divided by their standard deviation."""
    deviation = statistics.pstdev(scores)
    return [(score - statistics.mean(scores)) / (deviation + 1e-4) for score in scores]


def report(api, run, logs):
    """Reports action logs in batches; returns the scores of the episodes that count."""
    episodes, scores = list(logs), {}
    for first in range(0, len(episodes), BATCH):
        batch = [{"episode": id, "actions": {"steps": logs[id]}} for id in episodes[first : first + BATCH]]
        for result in api.request("POST", f"/{run}/results", {"results": batch})["results"]:
            if result["status"] in ("counted", "duplicate"):
                scores[result["episode"]] = result["score"]
            else:  # late or refused
                print(f"{result['episode']}: {result['status']} {result.get('detail', '')}")
    return scores


def train_on_lease(api, run, version, policy, args):
    """Runs and reports the episodes of one lease; returns the improved policy."""
    lease_request = {"groups": args.groups, "ttl_s": args.ttl, "policy_version": version, "disclosure": "begin"}
    lease = api.request("POST", f"/{run}/leases", lease_request)
    path, renewed = f"/{run}/leases/{lease['lease']}", time.monotonic()
    logs, variations, begun = {}, {}, []
    try:
        for undisclosed in lease["undisclosed"]:
            # The server discloses a scenario when its group begins. Groups that never begin return without loss.
            lease = api.request("POST", path + "/groups/begin", {"groups": [undisclosed["group"]]})
            group = lease["groups"][0]
            begun.append(group)
            for episode in group["episodes"]:
                variations[episode] = [random.gauss(0, 1) for _ in policy]
                varied = [value * math.exp(SIGMA * draw) for value, draw in zip(policy, variations[episode])]
                logs[episode] = run_episode(lease["recipes"][group["recipe"]], group["seed"], varied)
            if time.monotonic() - renewed > args.ttl / 2:
                api.request("POST", path + "/renew")
                renewed = time.monotonic()
    except BaseException:
        api.request("POST", path + "/release")  # the server takes the other groups back
        raise
    scores = report(api, run, logs)
    groups = [group["episodes"] for group in begun if all(episode in scores for episode in group["episodes"])]
    gradient = [0.0] * len(policy)
    for episodes in groups:
        for episode, advantage in zip(episodes, advantages([scores[episode] for episode in episodes])):
            weight = advantage / (len(groups) * len(episodes))
            gradient = [total + weight * draw for total, draw in zip(gradient, variations[episode])]
    mean = statistics.mean(scores.values()) if scores else math.nan
    policy = [value * math.exp(LEARNING_RATE * slope) for value, slope in zip(policy, gradient)]
    print(f"version {version}: {len(scores)} episodes, mean score {mean:.3f}; burns {policy[1]:.2f} within {policy[0]:.1f} LU")
    return policy


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--rounds", type=int, default=10, help="number of leases (%(default)s)")
    parser.add_argument("--groups", type=int, default=8, help="scenarios per lease (%(default)s)")
    parser.add_argument("--group-size", type=int, default=4, help="episodes per scenario (%(default)s)")
    parser.add_argument("--ttl", type=int, default=60, help="seconds until a lease expires, renewed after half (%(default)s)")
    args = parser.parse_args()

    api = Api(args.url)
    # examples/kessler.py does not support layouts, so no designer makes any.
    settings = {
        "tasks": ["kessler/survival"],
        "group_size": args.group_size,
        "strategy": "ladder",
        "placement": False,
        "design": {"designer": "off"},
    }
    run = api.request("POST", "", settings)["id"]
    policy = [1.0, 0.05]
    for version in range(args.rounds):
        policy = train_on_lease(api, run, version, policy, args)
    task = api.request("GET", f"/{run}/mastery")["tasks"][0]
    results = task["results"]
    print(f"run {run}: level {task['level']}, {results['episodes']} episodes, {results['successes']} of them fair successes")


if __name__ == "__main__":
    main()
