"""Prints the events of a run; after a lost connection it resumes after the last event.

    python examples/events.py --run my-run            # new events; --after 0 for all that the server keeps

It needs only the standard library: Server-Sent Events are lines of text.
"""

import argparse
import json
import os
import sys
import time
import urllib.error
import urllib.request

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


def listen(url, run, after):
    """Yields (id, kind, data) of each event, without end."""
    last_id, unreachable = after, False
    while True:
        query = "" if last_id is None else "?after=0"
        headers = dict(TOKEN) if last_id is None else {"Last-Event-ID": str(last_id), **TOKEN}
        try:
            request = urllib.request.Request(f"{url}/v1/runs/{run}/events{query}", headers=headers)
            with urllib.request.urlopen(request, timeout=60) as stream:
                event, unreachable = {}, False
                for line in stream:
                    name, _, value = line.decode().rstrip("\n").partition(": ")
                    if name in ("id", "event", "data"):
                        event[name] = value
                    elif not name:  # an empty line ends an event; a message with only an id sets the position
                        last_id = int(event.get("id", last_id or 0))
                        if "data" in event:
                            yield last_id, event["event"], json.loads(event["data"])
                        event = {}
        except urllib.error.HTTPError as error:
            if error.code not in (429, 503):
                raise SystemExit(f"{run}: {error.code} {error.read().decode()}") from error
        except OSError as error:
            if not unreachable:
                print(f"{url} does not answer, retrying: {error}", file=sys.stderr)
            unreachable = True
        time.sleep(1)


def describe(kind, data):
    """Returns an event as a line of text."""
    match kind:
        case "move":
            return f"{data['task']}: {data['kind']} to level {data['to']}: {data['evidence']['sentence']}"
        case "group":
            name = f"{data['task']}: group {data['group']} of {data['lease']}"
            return f"{name} is {data['state']}, {data['successes']} of {data['finished']} succeeded"
        case "worker" | "warning" | "gap":
            return data["message"]
        case _:
            return json.dumps({key: value for key, value in data.items() if key != "at"})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--run", required=True, help="id of the run")
    parser.add_argument("--after", type=int, help="id of the event to continue after; 0 for all that the server keeps")
    parser.add_argument("--count", type=int, default=0, help="number of events after which to stop (no limit)")
    args = parser.parse_args()
    for count, (id, kind, data) in enumerate(listen(args.url, args.run, args.after), 1):
        print(f"{data.get('at', '')} {id} {kind}: {describe(kind, data)}", flush=True)
        if count == args.count:
            return


if __name__ == "__main__":
    main()
