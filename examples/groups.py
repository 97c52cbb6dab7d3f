"""A trainer on groups: leases scenarios, flies each with several siblings in its own process, reports every action, and learns from
each sibling's score against the others'.

    sparring serve &
    python examples/groups.py --rounds 10

Nothing but the standard library. What it learns is how near debris may come before a satellite burns, and how hard: two numbers,
moved along what the better siblings tried (evolution strategies, Salimans et al. 2017), weighed as GRPO weighs (Shao et al. 2024).
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

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}
BATCH = 100  # results in a request
TRIED, STEP = 0.4, 1.0  # how far siblings differ, and how far the policy moves: factors of e


class Api:
    """The feed; asks again where the server is busy or away for a moment: whatever came before is answered as before."""

    def __init__(self, url):
        self.url = url + "/v1/runs"

    def ask(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        for _ in range(60):
            request = urllib.request.Request(self.url + path, data, {"Content-Type": "application/json", **TOKEN}, method=method)
            try:
                with urllib.request.urlopen(request, timeout=60) as answer:
                    return json.load(answer)
            except urllib.error.HTTPError as refused:
                problem = json.load(refused)
                if refused.code not in (429, 503):
                    raise SystemExit(f"{method} {path}: {problem.get('field', '')} {problem['detail']}") from refused
                time.sleep(float(refused.headers.get("Retry-After", 1)))
            except (OSError, http.client.HTTPException):
                time.sleep(1)
        raise SystemExit(f"{method} {path}: nobody answers")


def burns(episode, near, hard):
    """A burn away from the body that comes nearest to a satellite, where that is nearer than `near` LU within five steps."""
    ahead = lambda body: list(itertools.islice(itertools.accumulate(itertools.repeat(body), lambda at, _: kessler.coast(at)), 1, 6))
    debris = [ahead(body) for body in episode.debris]
    for satellite, body in enumerate(episode.satellites):
        if not episode.active[satellite]:
            continue
        path = ahead(body)
        passes = ((math.dist(own[:2], at[:2]), own, at) for others in debris for own, at in zip(path, others))
        miss, own, at = min(passes, default=(math.inf, None, None))
        if miss < near:  # along its way, forwards or backwards: that changes where it is then
            gap = (own[0] - at[0]) * body[2] + (own[1] - at[1]) * body[3]
            push = math.copysign(hard / math.hypot(*body[2:]), gap)
            yield [satellite, push * body[2], push * body[3]]


def fly(recipe, seed, policy):
    """The actions of one episode."""
    episode, steps = kessler.Survival(recipe, seed), []
    while not episode.done:
        steps.append(list(burns(episode, *policy)))
        episode.step(steps[-1])
    return steps


def advantages(scores):
    """Each score against its siblings'."""
    spread = statistics.pstdev(scores)
    return [(score - statistics.mean(scores)) / (spread + 1e-4) for score in scores]


def report(api, run, flown):
    """Reports what was flown, in batches; the score of each episode that counts."""
    names, scores = list(flown), {}
    for first in range(0, len(names), BATCH):
        batch = [{"episode": name, "actions": {"steps": flown[name]}} for name in names[first : first + BATCH]]
        for told in api.ask("POST", f"/{run}/results", {"results": batch})["results"]:
            if told["status"] in ("counted", "duplicate"):
                scores[told["episode"]] = told["score"]
            else:  # late, or refused: it says why
                print(f"{told['episode']}: {told['status']} {told.get('detail', '')}")
    return scores


def train_once(api, run, version, policy, args):
    """One lease: flown, reported, learnt from. The policy after it."""
    wish = {"groups": args.groups, "ttl_s": args.ttl, "policy_version": version}
    lease = api.ask("POST", f"/{run}/leases", wish)
    path, renewed = f"/{run}/leases/{lease['lease']}", time.monotonic()
    flown, tried = {}, {}
    try:
        for group in lease["groups"]:
            for name in group["episodes"]:
                tried[name] = [random.gauss(0, 1) for _ in policy]
                moved = [mean * math.exp(TRIED * draw) for mean, draw in zip(policy, tried[name])]
                flown[name] = fly(lease["recipes"][group["recipe"]], group["seed"], moved)
            if time.monotonic() - renewed > args.ttl / 2:  # in time, for who flies long
                api.ask("POST", path + "/renew")
                renewed = time.monotonic()
    except BaseException:
        api.ask("POST", path + "/release")  # what was not flown is lost to nobody: others are offered it
        raise
    scores = report(api, run, flown)
    steps, whole = [0.0] * len(policy), [group["episodes"] for group in lease["groups"] if all(name in scores for name in group["episodes"])]
    for names in whole:
        for name, advantage in zip(names, advantages([scores[name] for name in names])):
            steps = [step + advantage * draw / (len(whole) * len(names)) for step, draw in zip(steps, tried[name])]
    mean = statistics.mean(scores.values()) if scores else math.nan
    policy = [value * math.exp(STEP * step) for value, step in zip(policy, steps)]
    print(f"version {version}: {len(scores)} episodes earn {mean:.3f}; burns {policy[1]:.2f} within {policy[0]:.1f} LU")
    return policy


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--url", default="http://127.0.0.1:8700")
    args.add_argument("--rounds", type=int, default=10)
    args.add_argument("--groups", type=int, default=8, help="scenarios of a lease")
    args.add_argument("--group-size", type=int, default=4, help="siblings of a scenario")
    args.add_argument("--ttl", type=int, default=60, help="seconds that a lease holds, renewed at half of them")
    args = args.parse_args()

    api = Api(args.url)
    # The small world of examples/kessler.py knows no layouts: none is designed.
    wish = {"tasks": ["kessler/survival"], "group_size": args.group_size, "placement": False, "design": {"designer": "off"}}
    run = api.ask("POST", "", wish)["id"]
    policy = [1.0, 0.05]
    for version in range(args.rounds):
        policy = train_once(api, run, version, policy, args)
    task = api.ask("GET", f"/{run}/mastery")["tasks"][0]
    print(f"run {run}: level {task['level']}, {task['plain']['episodes']} episodes, {task['plain']['successes']} of them fair successes")


if __name__ == "__main__":
    main()
