"""Runs the client of the official MCP SDK against a server and against `sparring mcp`: mcp_clients.py URL SPARRING

Prints one line for each check and fails at the first difference.
"""
import asyncio, json, sys, urllib.error, urllib.request

from mcp import Client, StdioServerParameters
from server_metrics import read_gauge

URL, SPARRING = sys.argv[1], sys.argv[2]
BURN = {"burns": [{"satellite_id": 0, "delta_vx": 0.01, "delta_vy": 0.0}]}
TOOLS = ["fire_thrusters", "hold", "telemetry", "conjunctions"]


async def fly(server, objective):
    """Flies an episode to its end by tools; returns its first telemetry."""
    async with Client(server) as client:
        assert client.server_info.name == "sparring" and client.instructions, client.server_info
        assert client.protocol_version == "2025-11-25", client.protocol_version
        assert [tool.name for tool in (await client.list_tools()).tools] == TOOLS
        seen = (await client.call_tool("telemetry", {})).structured_content
        assert seen["observation"]["mission_objective"].startswith(objective), seen
        assert seen["step"] == 0, seen
        burnt = await client.call_tool("fire_thrusters", BURN)
        assert burnt.structured_content["step"] == 1 and not burnt.is_error, burnt
        assert json.loads(burnt.content[0].text) == burnt.structured_content
        refused = await client.call_tool("hold", {"steps": 0})
        assert refused.is_error and "steps: must be an integer from 1 to 1000, got 0" in refused.content[0].text, refused
        held = (await client.call_tool("hold", {"steps": 1000})).structured_content
        assert held["done"] is True, held
        over = await client.call_tool("hold", {})
        assert over.is_error and "the episode is over" in over.content[0].text, over
    return seen


async def over_http():
    await fly(URL + "/mcp", "SURVIVAL")
    assert read_gauge(URL, "sparring_sessions") == 0, "the client ended its session"
    print("streamable HTTP: an episode is flown, and the session ends with its client")


def post(message, headers=()):
    """Sends a message; returns status, headers and body of the response."""
    headers = {"content-type": "application/json", "accept": "application/json", **dict(headers)}
    request = urllib.request.Request(URL + "/mcp", json.dumps(message).encode(), headers)
    try:
        response = urllib.request.urlopen(request)
    except urllib.error.HTTPError as error:
        response = error
    with response:
        text = response.read().decode()
        is_json = response.headers.get_content_type() == "application/json"
        return response.status, response.headers, json.loads(text) if is_json and text else text


def by_hand():
    """The transport's rules, with JSON and with event streams."""
    initialize = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"protocolVersion": "2025-03-26"}}
    status, headers, body = post(initialize)
    assert status == 200 and body["result"]["protocolVersion"] == "2025-03-26", body
    session = {"Mcp-Session-Id": headers["Mcp-Session-Id"]}
    status, _, body = post({"jsonrpc": "2.0", "method": "notifications/initialized"}, session)
    assert (status, body) == (202, ""), (status, body)
    telemetry = {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": {"name": "telemetry"}}
    assert post(telemetry, session)[2]["result"]["structuredContent"]["step"] == 0
    events = {"accept": "application/json, text/event-stream"}
    status, headers, text = post(telemetry, {**session, **events})
    assert headers.get_content_type() == "text/event-stream" and text.startswith("event: message\ndata: {"), text
    # The header of OpenEnv's HTTP routes names a session as well.
    reset = urllib.request.Request(URL + "/reset", b'{"task": "rendezvous", "seed": 5}', {"content-type": "application/json", "x-session-id": "mine"})
    urllib.request.urlopen(reset).close()
    seen = post(telemetry, {"X-Session-Id": "mine"})[2]["result"]["structuredContent"]
    assert seen["observation"]["mission_objective"].startswith("RENDEZVOUS"), seen
    body = post(telemetry)[2]
    assert body["error"]["code"] == -32602 and "Mcp-Session-Id" in body["error"]["message"], body
    status, _, body = post(telemetry, {**session, "MCP-Protocol-Version": "1.0"})
    assert status == 400 and "2025-11-25" in body["error"]["data"]["supported"], body
    end = urllib.request.Request(URL + "/mcp", headers=session, method="DELETE")
    with urllib.request.urlopen(end) as response:
        assert response.status == 204
    assert post(telemetry, session)[0] == 404
    print("streamable HTTP: headers, notifications and event streams are as specified")


def run_program(*arguments):
    return StdioServerParameters(command=SPARRING, args=["mcp", *arguments])


async def over_stdio():
    seen = [await fly(run_program("--task", "rendezvous", "--seed", "5"), "RENDEZVOUS") for _ in range(2)]
    assert seen[0] == seen[1], "equal seeds give equal episodes"
    await fly(run_program("--url", URL, "--task", "survival"), "SURVIVAL")
    print("stdio: an episode is flown in the process, and on a server")


asyncio.run(over_http())
by_hand()
asyncio.run(over_stdio())
