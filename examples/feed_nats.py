"""A trainer on the feed of a run that NATS JetStream delivers, with nats-py alone: pip install nats-py

    nats-server -js &
    sparring serve --nats nats://127.0.0.1:4222 &
    python examples/feed_nats.py --run my-run                        # receives every group
    python examples/feed_nats.py --run my-run --consumer second      # receives every group, too
    python examples/feed_nats.py --run my-run --consumer second      # shares the groups of `second`

The example creates the run if it does not exist. A built-in policy acts, and the trainer counts the actions that a step of GRPO
would use. `sparring.feed.nats` of the wheel does the same in one line.
"""

import argparse
import asyncio
import json
import os
import ssl
import statistics
import sys
import urllib.error
import urllib.request

import nats
from nats.js.api import AckPolicy, ConsumerConfig
from nats.js.errors import BucketNotFoundError, NotFoundError, ObjectNotFoundError

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


def request(url, method, path, body):
    """Sends a request to the server. Returns the response, and None if the resource exists."""
    headers = {"Accept": "application/json", "Content-Type": "application/json", **TOKEN}
    message = urllib.request.Request(url + path, json.dumps(body).encode(), headers, method=method)
    try:
        with urllib.request.urlopen(message, timeout=120) as response:
            return json.load(response)
    except urllib.error.HTTPError as error:
        if error.code == 409:
            return None
        raise SystemExit(f"{method} {path}: {error.read().decode()}") from error


def learn(group):
    """Placeholder of a trainer's update; returns the number of actions with an advantage."""
    scores = [episode["score"] for episode in group["episodes"]]
    deviation = statistics.pstdev(scores)
    advantages = [(score - statistics.mean(scores)) / (deviation + 1e-4) for score in scores]
    return sum(len(episode["steps"]) for episode, advantage in zip(group["episodes"], advantages, strict=True) if advantage != 0)


def stream_of(nats_name, run):
    """Returns the name of the stream of a run, such as my-run, or east.my-run with a shard."""
    shard, dot, name = run.rpartition(".")
    return f"SPARRING_{nats_name}_FEED-{shard}_{name}" if dot else f"SPARRING_{nats_name}_FEED_{name}"


async def open_consumer(js, stream, name):
    """Creates the durable consumer. The server creates the stream soon after the policy was set."""
    config = ConsumerConfig(name=name, durable_name=name, ack_policy=AckPolicy.EXPLICIT, ack_wait=30, inactive_threshold=86_400)
    for _ in range(60):
        try:
            await js.add_consumer(stream, config)
            return await js.pull_subscribe_bind(consumer=name, stream=stream)
        except NotFoundError:
            await asyncio.sleep(0.5)
    raise SystemExit(f"there is no stream {stream}: was the server started with --nats?")


async def read_group(js, stream, message):
    """Returns the group of a message. A group above 512 KiB is in the object store."""
    name = (message.headers or {}).get("Sparring-Object")
    if name is None:
        return json.loads(message.data)
    bucket = await js.object_store(stream)
    return json.loads((await bucket.get(name)).data)


async def note_error(error):
    """Prints an error of the connection, and ends the program if the certificate of NATS is not valid: waiting does not help."""
    if isinstance(error, ssl.SSLCertVerificationError):
        raise SystemExit(f"the certificate of NATS is not valid here ({error.verify_message}): set --ca-file")
    print(f"NATS: {error or type(error).__name__}", file=sys.stderr, flush=True)


async def train(args):
    trust = ssl.create_default_context(cafile=args.ca_file) if args.ca_file else None
    # A key for trainers may only use replies of this prefix (deploy/nats.conf).
    options = {"inbox_prefix": "_INBOX_TRAINER", "nkeys_seed": args.nkey, "tls": trust, "error_cb": note_error}
    client = await nats.connect(args.nats, **options)
    js, stream = client.jetstream(), stream_of(args.nats_name, args.run)
    subscription = await open_consumer(js, stream, args.consumer)
    learned, useful = set(), 0
    while len(learned) < args.groups:
        try:
            [message] = await subscription.fetch(1, timeout=30)
        except nats.errors.TimeoutError:
            break
        try:
            group = await read_group(js, stream, message)
        except (ObjectNotFoundError, BucketNotFoundError):  # it was acknowledged over HTTP meanwhile
            await message.nak(delay=1)
            continue
        # A group can be delivered more than once, for example if NATS was killed.
        if group["id"] not in learned:
            learned.add(group["id"])
            useful += learn(group)
            print(f"group {group['id']:4} {group['task']} version {group['policy_version']}", flush=True)
        await message.ack_sync(timeout=10)
    await client.close()
    print(f"{len(learned)} groups, {useful} actions with an advantage")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--nats", default="nats://127.0.0.1:4222", help="address of the NATS server (%(default)s)")
    parser.add_argument("--nats-name", default="default", help="name of the servers on NATS (%(default)s)")
    parser.add_argument("--nkey", default=None, help="file with the seed of an nkey, if NATS requires one")
    parser.add_argument("--ca-file", default=None, help="PEM file with the certificate authority of NATS, if it is not public")
    parser.add_argument("--run", default="my-run", help="id of the run, which is created if it does not exist (%(default)s)")
    parser.add_argument("--consumer", default="trainer", help="name of the durable consumer (%(default)s)")
    parser.add_argument("--groups", type=int, default=40, help="number of groups to receive (%(default)s)")
    args = parser.parse_args()
    settings = {"id": args.run, "group_size": 8, "tasks": ["kessler/survival"]}
    if request(args.url, "POST", "/v1/runs", settings) is not None:
        request(args.url, "PUT", f"/v1/runs/{args.run}/policy", {"policy": "random", "version": 1, "delivery": "nats"})
    asyncio.run(train(args))


if __name__ == "__main__":
    main()
