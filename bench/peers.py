"""The public Python kessler-env and openenv-core's server beside Sparring's, in turns, in one run.

    make bench-peers [KESSLER_ENV=path/to/kessler-env]

With a copy of that environment both sides fly episodes of 50 steps in this machine's one thread: the Python environment
in-process, by small burns of about half of the satellites; Sparring's by `sparring bench --json`, its batch engine. They take
turns, and the best turn of each is compared.

Then `bench sockets` steps sessions of both servers over WebSockets. Without a copy of the public environment the peer is openenv-core's
own server with an environment that does nothing: the original can only be slower.
"""

import argparse
import importlib
import json
import os
import pathlib
import random
import subprocess
import sys
import time
import urllib.request

TURNS = 5
SECONDS = 1.0
STEPS = 50


def find_module(root: pathlib.Path) -> pathlib.Path:
    """The file that defines the environment."""
    for path in sorted(root.rglob("*.py")):
        if "class KesslerEnvironment" in path.read_text(encoding="utf-8", errors="replace"):
            return path
    raise SystemExit(f"{root}: no file in it defines KesslerEnvironment; is it a copy of the public kessler-env?")


def load(root: pathlib.Path):
    """The environment's class, imported as whatever package its folders make it."""
    path = find_module(root)
    faults = []
    # The module may import its siblings by the package's full name or by a shorter one: try from outside in.
    for base in [root.parent, *reversed(path.relative_to(root.parent).parents), path.parent]:
        base = base if base.is_absolute() else root.parent / base
        if base not in path.parents:
            continue
        name = ".".join(path.relative_to(base).with_suffix("").parts)
        sys.path.insert(0, str(base))
        try:
            return getattr(importlib.import_module(name), "KesslerEnvironment")
        except Exception as error:  # whatever a stranger's module raises on import
            faults.append(f"as {name}: {error}")
            sys.path.remove(str(base))
    raise SystemExit(f"{path} cannot be imported (is openenv-core installed?): " + "; ".join(faults))


def message_type(environment, ending: str, field: str):
    """A class of the environment's messages, found beside its own imports by the ending of its name and a field."""
    module = sys.modules[environment.__module__]
    for value in vars(module).values():
        if isinstance(value, type) and value.__name__.endswith(ending) and field in getattr(value, "model_fields", {}):
            return value
    raise SystemExit(f"{module.__name__} imports no {ending.lower()} with {field}")


def action_type(environment):
    """The class of the action `step` takes."""
    return message_type(environment, "Action", "burns")


def observation_type(environment):
    """The class of what `reset` answers."""
    return message_type(environment, "Observation", "total_score")


def python_turn(environment, action) -> float:
    """Steps a second of the Python environment."""
    draw = random.Random(0)
    actions = []
    for _ in range(97):
        burns = [
            {"satellite_id": satellite, "delta_vx": draw.uniform(-0.05, 0.05), "delta_vy": draw.uniform(-0.05, 0.05)}
            for satellite in range(3)
            if draw.random() < 0.5
        ]
        actions.append(action(burns=burns))
    steps, begun = 0, time.perf_counter()
    while time.perf_counter() - begun < SECONDS:
        env = environment()
        env.reset()
        for _ in range(STEPS):
            env.step(actions[steps % len(actions)])
            steps += 1
    return steps / (time.perf_counter() - begun)


def sparring_turn(binary: str) -> float:
    """Steps a second of the batch engine on one thread."""
    command = [binary, "bench", "--env", "kessler", "--seconds", str(SECONDS), "--json"]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(answer.stdout)["single_thread_env_steps_per_s"]


def in_process(args) -> None:
    """The engines."""
    root = pathlib.Path(args.kessler_env).resolve()
    if not root.is_dir():
        raise SystemExit(f"KESSLER_ENV={args.kessler_env} is no folder")
    environment = load(root)
    action = action_type(environment)
    python, sparring = [], []
    for turn in range(TURNS):
        python.append(python_turn(environment, action))
        sparring.append(sparring_turn(args.sparring))
        print(f"turn {turn + 1}: {python[-1]:.0f} and {sparring[-1]:.0f} steps/s", file=sys.stderr)
    best_python, best_sparring = max(python), max(sparring)
    print(f"public Python environment, in-process  {best_python:12.0f} steps/s  {1e6 / best_python:8.3f} us a step")
    print(f"Sparring's batch engine, one thread    {best_sparring:12.0f} steps/s  {1e6 / best_sparring:8.3f} us a step")
    print(f"ratio (goal: at least 400)             {best_sparring / best_python:12.0f}")


def over_sockets(args) -> None:
    """The servers."""
    command = [sys.executable, str(pathlib.Path(__file__).with_name("peer_server.py")), "--kessler-env", args.kessler_env]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            port = server.stdout.readline().strip()
            if not port:
                raise SystemExit("the Python server did not start")
            wait_for(int(port))
            name = "the public kessler-env" if args.kessler_env else "openenv-core with an environment that does nothing"
            peer = ["--peer", f"ws://127.0.0.1:{port}/ws", "--peer-pid", str(server.pid), "--peer-name", name]
            ours = os.environ | {"SPARRING_BINARY": str(pathlib.Path(args.sparring).resolve())}
            subprocess.run([args.bench, "sockets", *peer], check=True, env=ours)
        finally:
            server.terminate()


def wait_for(port: int) -> None:
    """Until the server answers."""
    for _ in range(100):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=1):
                return
        except OSError:
            time.sleep(0.2)
    raise SystemExit("the Python server does not answer")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="the sparring binary, built in release")
    parser.add_argument("--bench", required=True, help="the bench binary, built in release")
    parser.add_argument("--kessler-env", default="", help="a copy of the public kessler-env")
    args = parser.parse_args()
    if args.kessler_env:
        in_process(args)
    else:
        print("No copy of the public kessler-env was given, so it is not measured: make bench-peers KESSLER_ENV=path")
    over_sockets(args)


if __name__ == "__main__":
    main()
