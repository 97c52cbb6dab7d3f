"""Compares the public Python kessler-env and openenv-core's server with Sparring's.

    make bench-peers [KESSLER_ENV=path/to/kessler-env]

With a copy of the public environment, both sides run episodes of 50 steps on one thread: the Python environment in this process,
with small burns of about half of the satellites, and Sparring's batch engine by `sparring bench --json`. Turns alternate, and the
best turns are compared.

Then `bench sockets` steps sessions of both servers over WebSockets. Without a copy of the public environment, the server of
openenv-core has an environment that does nothing: the original can only be slower.
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

#: Turns of each side.
TURNS = 5
#: Duration of a turn, seconds.
SECONDS = 1.0
#: Steps of an episode.
STEPS = 50


def find_module(root: pathlib.Path) -> pathlib.Path:
    """Finds the file that defines the environment."""
    for path in sorted(root.rglob("*.py")):
        if "class KesslerEnvironment" in path.read_text(encoding="utf-8", errors="replace"):
            return path
    raise SystemExit(f"{root}: no file in it defines KesslerEnvironment; is it a copy of the public kessler-env?")


def load(root: pathlib.Path):
    """Imports the environment's class, with any of its parent folders as the root of its package."""
    path = find_module(root)
    errors = []
    # The module may import others by the full name of its package or a shorter one: try the longest name first.
    for base in [root.parent, *reversed(path.relative_to(root.parent).parents), path.parent]:
        base = base if base.is_absolute() else root.parent / base
        if base not in path.parents:
            continue
        name = ".".join(path.relative_to(base).with_suffix("").parts)
        sys.path.insert(0, str(base))
        try:
            return importlib.import_module(name).KesslerEnvironment
        except Exception as error:  # an unknown module may raise anything on import
            errors.append(f"as {name}: {error}")
            sys.path.remove(str(base))
    raise SystemExit(f"{path} cannot be imported (is openenv-core installed?): " + "; ".join(errors))


def message_type(environment, ending: str, field: str):
    """Finds a class among the environment's imports by the ending of its name and a field."""
    module = sys.modules[environment.__module__]
    for value in vars(module).values():
        if isinstance(value, type) and value.__name__.endswith(ending) and field in getattr(value, "model_fields", {}):
            return value
    raise SystemExit(f"{module.__name__} imports no {ending.lower()} with {field}")


def action_type(environment):
    """Returns the class of actions."""
    return message_type(environment, "Action", "burns")


def observation_type(environment):
    """Returns the class of observations."""
    return message_type(environment, "Observation", "total_score")


def python_turn(environment, action) -> float:
    """Returns steps per second of the Python environment."""
    rng = random.Random(0)
    actions = []
    for _ in range(97):
        burns = [
            {"satellite_id": satellite, "delta_vx": rng.uniform(-0.05, 0.05), "delta_vy": rng.uniform(-0.05, 0.05)}
            for satellite in range(3)
            if rng.random() < 0.5
        ]
        actions.append(action(burns=burns))
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < SECONDS:
        env = environment()
        env.reset()
        for _ in range(STEPS):
            env.step(actions[steps % len(actions)])
            steps += 1
    return steps / (time.perf_counter() - started)


def sparring_turn(binary: str) -> float:
    """Returns steps per second of the batch engine on one thread."""
    command = [binary, "bench", "--env", "kessler", "--seconds", str(SECONDS), "--json"]
    output = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(output.stdout)["single_thread_env_steps_per_s"]


def compare_engines(args) -> None:
    """Compares the engines without a server."""
    root = pathlib.Path(args.kessler_env).resolve()
    if not root.is_dir():
        raise SystemExit(f"KESSLER_ENV={args.kessler_env} is not a folder")
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


def compare_servers(args) -> None:
    """Compares the servers over WebSockets."""
    command = [sys.executable, str(pathlib.Path(__file__).with_name("peer_server.py")), "--kessler-env", args.kessler_env]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            port = server.stdout.readline().strip()
            if not port:
                raise SystemExit("the Python server did not start")
            wait_for_server(int(port))
            name = "the public kessler-env" if args.kessler_env else "openenv-core with an environment that does nothing"
            peer = ["--peer", f"ws://127.0.0.1:{port}/ws", "--peer-pid", str(server.pid), "--peer-name", name]
            environment = os.environ | {"SPARRING_BINARY": str(pathlib.Path(args.sparring).resolve())}
            subprocess.run([args.bench, "sockets", *peer], check=True, env=environment)
        finally:
            server.terminate()


def wait_for_server(port: int) -> None:
    """Waits until the server answers."""
    for _ in range(100):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=1):
                return
        except OSError:
            time.sleep(0.2)
    raise SystemExit("the Python server does not answer")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="path of the sparring binary, a release build")
    parser.add_argument("--bench", required=True, help="path of the bench binary, a release build")
    parser.add_argument("--kessler-env", default="", help="folder with a copy of the public kessler-env")
    args = parser.parse_args()
    if args.kessler_env:
        compare_engines(args)
    else:
        print("The public kessler-env is not measured without a copy of it: make bench-peers KESSLER_ENV=path")
    compare_servers(args)


if __name__ == "__main__":
    main()
