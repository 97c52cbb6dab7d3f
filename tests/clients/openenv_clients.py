"""openenv-core's own clients against a server: openenv_clients.py URL

Says what it did, line by line; fails at the first thing that is not as it should be.
"""
import asyncio, json, pathlib, re, shutil, subprocess, sys, urllib.request

from openenv.core.generic_client import GenericEnvClient
from openenv.core.mcp_client import MCPToolClient

URL = sys.argv[1]
ROOT = pathlib.Path(__file__).parents[2]
BURN = {"burns": [{"satellite_id": 0, "delta_vx": 0.01, "delta_vy": 0.0}]}


async def episode(seed):
    """One episode to its end; its first observation and its steps."""
    async with GenericEnvClient(base_url=URL) as env:
        told = await env.reset(seed=seed, task="survival")
        first, steps = told.observation, 0
        while not told.done:
            told = await env.step(BURN)
            steps += 1
        state = await env.state()
        assert state["step_count"] == steps, state
        return json.dumps(first["satellites"]), steps, told.observation["total_score"]


async def many():
    flown = await asyncio.gather(*(episode(seed) for seed in range(32)))
    assert len({first for first, _, _ in flown}) == 32, "32 seeds are 32 worlds"
    assert all(1 <= steps <= 50 for _, steps, _ in flown), flown
    again = await episode(7)
    assert again == flown[7], "one seed, one world"
    print("async: 32 sessions at once, to the end")


def one_after_the_other():
    with GenericEnvClient(base_url=URL).sync() as env:
        goals = []
        for _ in range(4):
            told = env.reset()
            goals.append(told.observation["mission_objective"].split(":")[0])
        assert goals == ["SURVIVAL", "ECO-STATION", "RENDEZVOUS", "SURVIVAL"], goals
        told = env.reset(task="docking/single", seed=3)
        assert len(told.observation["deputies"]) == 1, told
        told = env.step({"thrusts": [{"deputy_id": 0, "thrust_x": 0.1, "thrust_y": 0, "thrust_z": 0}]})
        assert told.done is False, told
    print("sync: four resets walk through the tasks, docking by its own schema")


async def tools():
    async with MCPToolClient(base_url=URL) as env:
        await env.reset(task="survival", seed=5)
        names = [tool.name for tool in await env.list_tools()]
        assert names == ["fire_thrusters", "hold", "telemetry", "conjunctions"], names
        seen = await env.call_tool("telemetry")
        assert seen["step"] == 0, seen
        told = await env.call_tool("fire_thrusters", **BURN)
        assert told["step"] == 1, told
        try:
            await env.call_tool("fire_thrusters", burns="x")
        except RuntimeError as error:
            assert "burns" in str(error), error
        else:
            raise AssertionError("a bad call must fail")
        told = await env.call_tool("hold", steps=60)
        assert told["done"] is True, told
        assert (await env.call_tool("conjunctions"))["conjunctions"] is not None
    print("MCPToolClient: lists and calls the tools")


def validated():
    report = subprocess.run(
        [sys.executable, "-m", "openenv.cli", "validate", "--url", URL], capture_output=True, text=True
    )
    told = json.loads(report.stdout)
    assert report.returncode == 0 and told["passed"], report.stdout + report.stderr
    failed = [criterion for criterion in told["criteria"] if not criterion["passed"]]
    assert not failed, failed
    print(f"openenv validate: {told['summary']['passed_count']} of {told['summary']['total_count']} criteria")


def documented():
    """What docs/openenv.md shows in Python and for the shell, as it stands there but for the address."""
    text = (ROOT / "docs/openenv.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(python|sh)\n(.*?)^```", text, re.M | re.S)
    ran = 0
    for kind, block in blocks:
        block = block.replace("127.0.0.1:8700", URL.removeprefix("http://"))
        if kind == "python":
            told = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True)
            assert told.returncode == 0 and 0 < float(told.stdout) < 1, told
        elif "curl" in block and shutil.which("curl"):
            told = subprocess.run(["sh", "-ec", block], capture_output=True, text=True)
            assert told.returncode == 0 and told.stdout.count('"observation"') == 2, told
        else:
            continue
        ran += 1
    assert ran == (3 if shutil.which("curl") else 2), ran
    print(f"docs/openenv.md: {ran} examples run")


def trained():
    """The environment class that TRL is given, without TRL: siblings fly one scenario, and the run is told."""
    sys.path.insert(0, str(ROOT / "examples"))
    import grpo_trl

    grpo_trl.ARGS.url, grpo_trl.ARGS.siblings = URL, 2
    grpo_trl.ARGS.run = grpo_trl.create_run()
    siblings = [grpo_trl.Pilot() for _ in range(2)]
    first = {pilot.reset(group_id="g0", prompt=[]) for pilot in siblings}
    assert len(first) == 1 and "Satellite 0, fuel" in first.pop()
    assert "Satellite" in siblings[0].fire(0, 0.1, 0.0) and "Satellite" in siblings[1].hold(3)
    assert "over" in siblings[1].hold(50)
    scores = [pilot.get_reward() for pilot in siblings]
    with urllib.request.urlopen(f"{URL}/v1/runs/{grpo_trl.ARGS.run}/episodes") as answer:
        stored = [episode["score"] for episode in json.load(answer)["episodes"]]
    assert sorted(stored) == sorted(scores) or max(abs(a - b) for a, b in zip(sorted(stored), sorted(scores))) < 1e-9, (stored, scores)
    print("examples/grpo_trl.py: two siblings, one scenario, both reported")


asyncio.run(many())
one_after_the_other()
asyncio.run(tools())
validated()
documented()
trained()
