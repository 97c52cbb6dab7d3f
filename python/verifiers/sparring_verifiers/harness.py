"""Harness that runs the conversation in this process, and the tools on the episode of the rollout."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import verifiers.v1 as vf
from openai import APIStatusError, AsyncOpenAI
from verifiers.v1.harnesses.utils.compaction import is_context_overflow

from .session_episode import SessionEpisode, tool_schemas
from .taskset import running, step_threads


class SparringHarnessConfig(vf.HarnessConfig):
    """Configuration of the harness, which has no fields of its own."""


class SparringHarness(vf.Harness[SparringHarnessConfig]):
    """Calls the model until it calls no tool, the episode is over, or verifiers stops the rollout."""

    APPENDS_SYSTEM_PROMPT = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    async def launch(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
    ) -> vf.ProgramResult:
        """Runs the conversation of a rollout.

        Raises:
            SessionError: The server of the episode lost it, or cannot be reached in time.
            openai.APIError: The model cannot be reached.
        """
        episode = running[trace.id].episode
        system, prompt = self.resolve_text_prompt(data)
        messages: list[Any] = [{"role": "system", "content": system}] if system else []
        messages.append({"role": "user", "content": f"{prompt}\n\n{episode.first_text}"})
        tools: Any = tool_schemas()
        # verifiers bounds the time of a rollout; a model may take long to answer.
        async with AsyncOpenAI(base_url=endpoint, api_key=secret, timeout=None) as client:
            while not episode.over:
                try:
                    completion: Any = await client.chat.completions.create(model=ctx.model, messages=messages, tools=tools)
                except APIStatusError as error:
                    # A conversation that fills the context is the end of the agent's answers, not a failure.
                    if is_context_overflow(error):
                        break
                    raise
                message = completion.choices[0].message
                messages.append(message.model_dump(exclude_none=True))
                if not message.tool_calls:
                    break
                for call in message.tool_calls:
                    content = await _call_tool(episode, call.function.name, call.function.arguments)
                    messages.append({"role": "tool", "tool_call_id": call.id, "content": content})
        return vf.ProgramResult(exit_code=0, stdout="", stderr="")

    async def cleanup(self, trace: vf.Trace, runtime: vf.Runtime) -> None:
        """Reports the episode of a failed or cancelled rollout as failed."""
        begun = running.pop(trace.id, None)
        if begun is not None:
            reason = trace.last_error.message if trace.last_error else "the rollout was cancelled"
            await asyncio.get_running_loop().run_in_executor(step_threads, begun.fail, reason)


async def _call_tool(episode: SessionEpisode, name: str, arguments: str) -> str:
    """Calls a tool; returns its text, or the error for the model."""
    try:
        parsed = json.loads(arguments or "{}")
    except ValueError:
        parsed = arguments
    try:
        return await asyncio.get_running_loop().run_in_executor(step_threads, episode.call, name, parsed)
    except ValueError as error:
        return f"error: {error}"
