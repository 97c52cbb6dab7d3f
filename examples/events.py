"""Listens to what happens in a run, and goes on where it was when the connection is lost.

    python examples/events.py --run my-run            # from now on; --after 0 for all that is kept

Nothing but the standard library: Server-Sent Events are lines of text.
"""
import argparse
import json
import os
import sys
import time
import urllib.error
import urllib.request

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


def listen(url, run, after):
    """Yields (id, kind, data), for ever."""
    last, away = after, False
    while True:
        query = "" if last is None else "?after=0"
        headers = dict(TOKEN) if last is None else {"Last-Event-ID": str(last), **TOKEN}
        try:
            request = urllib.request.Request(f"{url}/v1/runs/{run}/events{query}", headers=headers)
            with urllib.request.urlopen(request, timeout=60) as stream:
                event, away = {}, False
                for line in stream:
                    name, _, value = line.decode().rstrip("\n").partition(": ")
                    if name in ("id", "event", "data"):
                        event[name] = value
                    elif not name:  # an empty line ends an event; an id alone says where to go on
                        last = int(event.get("id", last or 0))
                        if "data" in event:
                            yield last, event["event"], json.loads(event["data"])
                        event = {}
        except urllib.error.HTTPError as error:
            if error.code not in (429, 503):
                raise SystemExit(f"{run}: {error.code} {error.read().decode()}")
        except OSError as error:  # the server went away, or says nothing: it is asked again
            if not away:
                print(f"{url} does not answer, and is asked again: {error}", file=sys.stderr)
            away = True
        time.sleep(1)


def words(kind, data):
    """An event in a line."""
    match kind:
        case "move":
            return f"{data['task']}: {data['kind']} to level {data['to']}: {data['evidence']['sentence']}"
        case "group":
            return f"{data['task']}: group {data['group']} of {data['lease']} is {data['state']}, {data['successes']} of {data['finished']} succeeded"
        case "health" | "gap":
            return data["words"]
        case _:
            return json.dumps({key: value for key, value in data.items() if key != "at"})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8700")
    parser.add_argument("--run", required=True)
    parser.add_argument("--after", type=int, help="the event after which to begin; 0 for all that are kept")
    parser.add_argument("--count", type=int, default=0, help="end after so many")
    args = parser.parse_args()
    for count, (number, kind, data) in enumerate(listen(args.url, args.run, args.after), 1):
        print(f"{data['at'] if 'at' in data else ''} {number} {kind}: {words(kind, data)}", flush=True)
        if count == args.count:
            return


if __name__ == "__main__":
    main()
