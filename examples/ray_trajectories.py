"""Ray actors that pull the trajectories of a run: each claims groups of the feed and reduces them; the driver acknowledges.

    pip install 'sparring[rllib,client]'
    sparring serve &
    python examples/ray_trajectories.py                                    # a run with a built-in policy, Ray on this machine
    python examples/ray_trajectories.py --ray auto --url http://head:8700 --run my-run --actors 8

The server delivers a group to one actor at a time. The driver acknowledges a group once it has its row, so that a group whose
actor or node dies is delivered again after --ttl seconds; the id of the group shows whether the driver already has it. Without
--run the program creates a run, lets the server roll out --policy until there are --groups groups, and empties the feed. With
--run it pulls from a run that has a policy, such as `chat`.

A server with tokens reads the token from `SPARRING_TOKEN`, in the environment of the driver and of `ray start`.
"""

import argparse
import os
import statistics
import time
from collections import Counter, defaultdict

import ray

import sparring

#: Longest wait of an actor for a group, seconds.
WAIT_S = 5


def advantages(scores):
    """Returns the scores of a group, normalised as in GRPO (Shao et al. 2024)."""
    mean, deviation = statistics.mean(scores), statistics.pstdev(scores)
    return [(score - mean) / (deviation + 1e-4) for score in scores]


def summarize(group):
    """Reduces a group to a row. A trainer would tokenize here, or return the steps with their advantages."""
    scores = [episode["score"] for episode in group["episodes"]]
    useful = [episode for episode, value in zip(group["episodes"], advantages(scores), strict=True) if value]
    return {
        "id": group["id"],
        "deliveries": group["deliveries"],
        "task": group["task"],
        "level": group["level"],
        "version": group["policy_version"],
        "scores": scores,
        "steps": sum(len(episode["steps"]) for episode in group["episodes"]),
        "actions": sum(step["action"] is not None for episode in useful for step in episode["steps"]),
    }


@ray.remote(num_cpus=0.5, max_restarts=-1, max_task_retries=-1, scheduling_strategy="SPREAD")
class Puller:
    """Actor that claims groups. Ray starts it again, on another node if its own is dead, and repeats the call."""

    def __init__(self, url, run, limit, ttl_s):
        self.client = sparring.Client(url)
        self.run, self.claim = run, {"limit": limit, "ttl_s": ttl_s, "wait_s": WAIT_S}

    def pull(self):
        """Claims groups; returns a row of each, none if there is no group within the wait."""
        node = ray.get_runtime_context().get_node_id()
        page = self.client.trajectories.claim(self.run, **self.claim)
        return [{**summarize(group), "node": node} for group in page["groups"]]

    def process(self):
        """Returns the number of the actor's process."""
        return os.getpid()


def collect(client, run, pullers, rows, is_complete, on_row=print):
    """Pulls groups by all actors until `is_complete()`; adds the row of each group to `rows` by its id."""
    pending = {} if is_complete() else {puller.pull.remote(): puller for puller in pullers}
    while pending:
        done = ray.wait(list(pending))[0][0]
        puller, pulled = pending.pop(done), ray.get(done)
        for row in pulled:
            # A group is delivered again if its actor died after the claim, or if the acknowledgement came too late.
            if row["id"] not in rows:
                rows[row["id"]] = row
                on_row(row)
        if pulled:
            client.trajectories.acknowledge(run, ids=[row["id"] for row in pulled])
        if not is_complete():
            pending[puller.pull.remote()] = puller


def is_empty(client, run):
    """Returns True if every group of the feed is acknowledged, also those that an actor claimed before it died."""
    feed = client.trajectories.get_policy(run)["feed"]
    return feed["waiting"] == feed["delivered"] == 0


def report(rows, seconds):
    """Prints a line for each task and level, and the shares of the nodes."""
    by_level = defaultdict(list)
    for row in rows:
        by_level[row["task"], row["level"]].append(row)
    for (task, level), at_level in sorted(by_level.items(), key=str):
        scores = [score for row in at_level for score in row["scores"]]
        equal = sum(len(set(row["scores"])) == 1 for row in at_level)
        print(f"{task} L{level}: {len(at_level)} groups, mean score {statistics.mean(scores):.3f}, {equal} with zero variance")
    episodes, steps = sum(len(row["scores"]) for row in rows), sum(row["steps"] for row in rows)
    nodes = Counter(row["node"] for row in rows)
    print(
        f"{len(rows)} groups, {episodes} episodes, {steps} steps, {sum(row['actions'] for row in rows)} actions with an "
        f"advantage; groups by node: {', '.join(map(str, nodes.values()))}; {len(rows) / seconds:.1f} groups/s"
    )


def print_row(row):
    scores = " ".join(f"{score:.3f}" for score in row["scores"])
    name = f"group {row['id']:4} {row['task']} L{row['level']} version {row['version']} node {row['node'][:6]}"
    print(f"{name}: {scores}", flush=True)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--run", help="id of a run with a policy (default: create a run)")
    parser.add_argument("--policy", default="random", help="policy of the run to create: a built-in one, or chat (%(default)s)")
    parser.add_argument("--actors", type=int, default=2, help="actors, half a core each (%(default)s)")
    parser.add_argument("--groups", type=int, default=40, help="smallest number of groups to pull (%(default)s)")
    parser.add_argument("--limit", type=int, default=4, help="groups of a claim (%(default)s)")
    parser.add_argument("--ttl", type=int, default=300, help="seconds until a claimed group is delivered again (%(default)s)")
    parser.add_argument("--ray", default="local", help="address of Ray; `auto` for the cluster of `ray start` (%(default)s)")
    args = parser.parse_args()
    if min(args.actors, args.groups, args.limit, args.ttl) < 1:
        parser.error("--actors, --groups, --limit and --ttl must be >= 1")
    return args


def main():
    args = parse_arguments()
    local = {"num_cpus": max(1, (args.actors + 1) // 2), "include_dashboard": False, "object_store_memory": 2**27}
    ray.init(args.ray, log_to_driver=False, **(local if args.ray == "local" else {}))
    with sparring.Client(args.url) as client:
        run = args.run
        if run is None:
            run = client.runs.create(name="Trajectories for Ray", tasks=["kessler/survival"], group_size=8, tags=["ray"])["id"]
            client.trajectories.set_policy(run, policy=args.policy, version=1, max_unacknowledged_groups=8 * args.actors)
        print(f"run {run} at {args.url}", flush=True)
        pullers = [Puller.remote(args.url, run, args.limit, args.ttl) for _ in range(args.actors)]
        started = time.perf_counter()
        rows = {}
        collect(client, run, pullers, rows, lambda: len(rows) >= args.groups, print_row)
        if args.run is None:
            client.trajectories.set_policy(run, policy="off")
            collect(client, run, pullers, rows, lambda: is_empty(client, run), print_row)
        report(list(rows.values()), time.perf_counter() - started)
    ray.shutdown()


if __name__ == "__main__":
    main()
