"""Runs the clients of openenv-core 0.3.0 or openenv 0.10 against a server: openenv_clients.py URL

Prints one line for each check and fails at the first difference.
"""
import asyncio, importlib.util, json, pathlib, re, shutil, subprocess, sys, urllib.request

from openenv.core.generic_client import GenericEnvClient
from openenv.core.mcp_client import MCPToolClient

URL = sys.argv[1]
ROOT = pathlib.Path(__file__).parents[2]
BURN = {"burns": [{"satellite_id": 0, "delta_vx": 0.01, "delta_vy": 0.0}]}


async def run_episode(seed):
    """Runs an episode to its end; returns the first satellites, the number of steps and the total score."""
    async with GenericEnvClient(base_url=URL) as env:
        result = await env.reset(seed=seed, task="survival")
        first, steps = result.observation, 0
        while not result.done:
            result = await env.step(BURN)
            steps += 1
        state = await env.state()
        assert state["step_count"] == steps, state
        return json.dumps(first["satellites"]), steps, result.observation["total_score"]


async def run_concurrent_episodes():
    results = await asyncio.gather(*(run_episode(seed) for seed in range(32)))
    assert len({first for first, _, _ in results}) == 32, "32 seeds give 32 scenarios"
    assert all(1 <= steps <= 50 for _, steps, _ in results), results
    repeated = await run_episode(7)
    assert repeated == results[7], "equal seeds give equal episodes"
    print("async: 32 concurrent sessions, run to the end")


def run_synchronous_client():
    with GenericEnvClient(base_url=URL).sync() as env:
        goals = []
        for _ in range(4):
            result = env.reset()
            goals.append(result.observation["mission_objective"].split(":")[0])
        assert goals == ["SURVIVAL", "ECO-STATION", "RENDEZVOUS", "SURVIVAL"], goals
        result = env.reset(task="docking/single", seed=3)
        assert len(result.observation["deputies"]) == 1, result
        result = env.step({"thrusts": [{"deputy_id": 0, "thrust_x": 0.1, "thrust_y": 0, "thrust_z": 0}]})
        assert result.done is False, result
    print("sync: four resets cycle through the tasks; docking has its own schema")


async def run_mcp_client():
    async with MCPToolClient(base_url=URL) as env:
        await env.reset(task="survival", seed=5)
        names = [tool.name for tool in await env.list_tools()]
        assert names == ["fire_thrusters", "hold", "telemetry", "conjunctions"], names
        seen = await env.call_tool("telemetry")
        assert seen["step"] == 0, seen
        result = await env.call_tool("fire_thrusters", **BURN)
        assert result["step"] == 1, result
        try:
            await env.call_tool("fire_thrusters", burns="x")
        except RuntimeError as error:
            assert "burns" in str(error), error
        else:
            raise AssertionError("a bad call must fail")
        result = await env.call_tool("hold", steps=60)
        assert result["done"] is True, result
        assert (await env.call_tool("conjunctions"))["conjunctions"] is not None
    print("MCPToolClient: lists and calls the tools")


def run_validator():
    command = [sys.executable, "-m", "openenv.cli", "validate", "--url", URL]
    if importlib.util.find_spec("openenv.validation"):  # openenv 0.10 prints text by default
        command.append("--json")
    report = subprocess.run(command, capture_output=True, text=True)
    result = json.loads(report.stdout)
    assert report.returncode == 0 and result["passed"], report.stdout + report.stderr
    failed = [criterion for criterion in result["criteria"] if not criterion["passed"]]
    assert not failed, failed
    print(f"openenv validate: {result['summary']['passed_count']} of {result['summary']['total_count']} criteria")


def run_documented_examples():
    """Runs the Python and shell examples of docs/reference/openenv.md with the address of this server."""
    text = (ROOT / "docs/reference/openenv.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(python|sh)\n(.*?)^```", text, re.M | re.S)
    ran = 0
    for kind, block in blocks:
        block = block.replace("127.0.0.1:8700", URL.removeprefix("http://"))
        if kind == "python":
            result = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True)
            assert result.returncode == 0, result
            if "/harness" in block:
                assert "session_started" in result.stdout and result.stdout.count("turn_complete") == 1, result
            else:
                assert 0 < float(result.stdout) < 1, result
        elif "curl" in block and shutil.which("curl"):
            result = subprocess.run(["sh", "-ec", block], capture_output=True, text=True)
            assert result.returncode == 0 and result.stdout.count('"observation"') == 2, result
        else:
            continue
        ran += 1
    assert ran == (4 if shutil.which("curl") else 3), ran
    print(f"docs/reference/openenv.md: {ran} examples run")


def run_grpo_example():
    """Runs the environment class of the TRL example without TRL: a group shares a scenario, and its episodes are reported."""
    sys.path.insert(0, str(ROOT / "examples"))
    import grpo_openenv

    grpo_openenv.ARGS.url, grpo_openenv.ARGS.group_size = URL, 2
    grpo_openenv.ARGS.run = grpo_openenv.create_run()
    members = [grpo_openenv.ToolEnvironment() for _ in range(2)]
    first = {member.reset(group_id="g0", prompt=[]) for member in members}
    assert len(first) == 1 and "Satellite 0, fuel" in first.pop()
    assert "Satellite" in members[0].fire(0, 0.1, 0.0) and "Satellite" in members[1].hold(3)
    assert "over" in members[1].hold(50)
    scores = [member.get_reward() for member in members]
    with urllib.request.urlopen(f"{URL}/v1/runs/{grpo_openenv.ARGS.run}/episodes") as answer:
        stored = [episode["score"] for episode in json.load(answer)["episodes"]]
    assert sorted(stored) == sorted(scores) or max(abs(a - b) for a, b in zip(sorted(stored), sorted(scores))) < 1e-9, (stored, scores)
    print("examples/grpo_openenv.py: two episodes of one scenario, both reported")


asyncio.run(run_concurrent_episodes())
run_synchronous_client()
asyncio.run(run_mcp_client())
run_validator()
run_documented_examples()
run_grpo_example()
