"""The public Python kessler-env beside Sparring's engine, in turns, in one run.

    make bench-peers KESSLER_ENV=path/to/kessler-env

needs a copy of that environment and a Python that can import it (openenv-core installed). Both sides fly episodes of 50
steps in this machine's one thread: the Python environment in-process, by small burns of about half of the satellites;
Sparring's by `sparring bench --json`, its batch engine. They take turns, and the best turn of each is compared.
"""

import argparse
import importlib
import json
import pathlib
import random
import subprocess
import sys
import time

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


def action_type(environment):
    """The class of the action `step` takes, found beside the environment's own imports."""
    module = sys.modules[environment.__module__]
    for value in vars(module).values():
        if isinstance(value, type) and value.__name__.endswith("Action") and "burns" in getattr(value, "model_fields", {}):
            return value
    raise SystemExit(f"{module.__name__} imports no action with burns")


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="the sparring binary, built in release")
    parser.add_argument("--kessler-env", default="", help="a copy of the public kessler-env")
    args = parser.parse_args()
    if not args.kessler_env:
        print("No copy of the public kessler-env was given, so it is not measured: make bench-peers KESSLER_ENV=path")
        return
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


if __name__ == "__main__":
    main()
