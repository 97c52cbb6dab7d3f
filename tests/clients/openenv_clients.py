"""openenv-core's own clients against a server: openenv_clients.py URL

Says what it did, line by line; fails at the first thing that is not as it should be.
"""
import asyncio, json, subprocess, sys

from openenv.core.generic_client import GenericEnvClient
from openenv.core.mcp_client import MCPToolClient

URL = sys.argv[1]
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


asyncio.run(many())
one_after_the_other()
asyncio.run(tools())
validated()
