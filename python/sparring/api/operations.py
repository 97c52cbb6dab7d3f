"""The operations of a server's API, to wait for and to await. Written by scripts/python-client: do not edit."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Any, Literal, Protocol
from urllib.parse import quote

from typing_extensions import Unpack

from . import types


class Asks(Protocol):
    """Who asks the server, and waits for its answer."""

    def __call__(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Any: ...


class AsksLater(Protocol):
    """The same, to be awaited."""

    def __call__(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Awaitable[Any]: ...


def _part(text: str) -> str:
    # An id is never more than one part of a path, whatever is in it.
    return quote(text, safe="")


class Designs:
    """Layouts designed for what the agent fails at, and asking for more."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list_layouts(
        self,
        *,
        task: str | None = None,
        state: str | None = None,
        aim: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Designs:
        """List the layouts of all runs that the gate let through, the newest first.

        Args:
            task: Of this task.
            state: In this state: `active` or `retired`.
            aim: That go for this failure mode.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Designs = self._ask(
            "GET", "/v1/layouts", {"task": task, "state": state, "aim": aim, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def show_layout(self, layout: str) -> types.Layout:
        """Show a layout with its whole scenario, bodies included, and what it is worth."""
        answer: types.Layout = self._ask("GET", f"/v1/layouts/{_part(layout)}", {}, None, again=True)
        return answer

    def list(
        self,
        run: str,
        *,
        task: str | None = None,
        state: str | None = None,
        mode: str | None = None,
        ask: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Designs:
        """List what designers thought of for a run, the newest first: layouts that serve or served, and what the gate refused
        (at most 64 of an ask are kept; all are counted in its answer and in the summary).

        Args:
            task: Of this task.
            state: In this state: `active`, `retired` or `refused`.
            mode: That go for this failure mode.
            ask: Of this ask.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Designs = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/designs",
            {"task": task, "state": state, "mode": mode, "ask": ask, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer

    def ask(self, run: str, **body: Unpack[types.DesignAsk]) -> types.AskView:
        """Ask a designer for layouts that go for what the agent fails at. It is answered at once, and done behind everything
        else: the ask's `state` says how far it is.
        """
        answer: types.AskView = self._ask("POST", f"/v1/runs/{_part(run)}/designs", {}, body, again=False)
        return answer

    def list_asks(
        self, run: str, *, task: str | None = None, state: str | None = None, limit: int | None = None, cursor: str | None = None
    ) -> types.Asks:
        """List what designers were asked for a run, the newest first.

        Args:
            task: For this task.
            state: In this state: `waiting`, `running`, `done` or `failed`.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Asks = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/designs/asks",
            {"task": task, "state": state, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer

    def show_ask(self, run: str, ask: str) -> types.Ask:
        """Show an ask, with the failure profile it rested on."""
        answer: types.Ask = self._ask("GET", f"/v1/runs/{_part(run)}/designs/asks/{_part(ask)}", {}, None, again=True)
        return answer

    def summarise(self, run: str) -> types.Summary:
        """Show what was designed for a run in numbers: by state, by what the gate said, and how much of training it is."""
        answer: types.Summary = self._ask("GET", f"/v1/runs/{_part(run)}/designs/summary", {}, None, again=True)
        return answer

    def show(self, run: str, design: str) -> types.Design:
        """Show a design: its encounters, what the gate said, what it is worth, and how the agent fared."""
        answer: types.Design = self._ask("GET", f"/v1/runs/{_part(run)}/designs/{_part(design)}", {}, None, again=True)
        return answer

    def retire(self, run: str, design: str) -> types.DesignHead:
        """Retire a layout by hand: it is never served again. Groups of it that are leased already end as they would have."""
        answer: types.DesignHead = self._ask(
            "POST", f"/v1/runs/{_part(run)}/designs/{_part(design)}/retire", {}, None, again=True
        )
        return answer

    def revive(self, run: str, design: str) -> types.DesignHead:
        """Put a retired layout back, whyever it was retired: it serves again, and what it was retired for is forgotten."""
        answer: types.DesignHead = self._ask(
            "POST", f"/v1/runs/{_part(run)}/designs/{_part(design)}/revive", {}, None, again=True
        )
        return answer


class Episodes:
    """Single attempts, and their replay."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Episodes:
        """List reported episodes.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Episodes = self._ask(
            "GET", f"/v1/runs/{_part(run)}/episodes", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def search(
        self,
        run: str,
        *,
        task: str | None = None,
        level: int | None = None,
        state: Literal["finished", "failed", "late"] | None = None,
        success: bool | None = None,
        mode: str | None = None,
        role: Literal[
            "placement", "frontier", "rehearsal", "sample", "explore", "replay", "edit", "boundary", "designed", "suite"
        ]
        | None = None,
        layout: str | None = None,
        version: int | None = None,
        order: Literal["newest", "oldest", "worst_score", "best_score", "worst_skill", "best_skill"] | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.FoundEpisodes:
        """Look for reported episodes, of those that are kept whole: `GET …/episodes` lists all, the oldest first. Orders by
        score and skill leave out those that have none.

        Args:
            task: Of this task.
            level: Of this level.
            state: How it came back.
            success: Successes (true), or what are none (false).
            mode: In which this failure mode was found: of those that are kept as examples of it.
            role: Of groups of this role.
            layout: On this layout.
            version: Flown by this version of the policy.
            order: In which order (newest).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before, asked for with the same words.
        """
        answer: types.FoundEpisodes = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/episodes/search",
            {
                "task": task,
                "level": level,
                "state": state,
                "success": success,
                "mode": mode,
                "role": role,
                "layout": layout,
                "version": version,
                "order": order,
                "limit": limit,
                "cursor": cursor,
            },
            None,
            again=True,
        )
        return answer

    def show(self, run: str, episode: str) -> types.Episode:
        """Show an episode: its scenario, and how it went."""
        answer: types.Episode = self._ask("GET", f"/v1/runs/{_part(run)}/episodes/{_part(episode)}", {}, None, again=True)
        return answer

    def replayed(
        self, run: str, episode: str, *, telemetry: bool | None = None, plan: Literal["agent", "hold", "reference"] | None = None
    ) -> types.Replay:
        """Replay an episode on the server: the whole state, step by step.

        Args:
            telemetry: Whether frames also hold what the agents saw (false).
            plan: Who flies it: the agent, as it did; nobody; or the plan that the scenario's reference score is of
                (agent).
        """
        answer: types.Replay = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/episodes/{_part(episode)}/replay",
            {"telemetry": telemetry, "plan": plan},
            None,
            again=True,
        )
        return answer


class Evaluations:
    """Evaluations"""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list(self, *, limit: int | None = None, cursor: str | None = None) -> types.Evaluations:
        """List evaluations, the newest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Evaluations = self._ask("GET", "/v1/evaluations", {"limit": limit, "cursor": cursor}, None, again=True)
        return answer

    def begin(self, **body: Unpack[types.EvaluationWish]) -> types.Evaluation:
        """Begin an evaluation on a frozen suite. Without `run` the server flies a built-in policy. With `run` its trainer
        flies: it leases scenarios (`purpose: eval`, `evaluation`: this id) and reports results as ever, until none is left.
        What its seeds make is never trained on.
        """
        answer: types.Evaluation = self._ask("POST", "/v1/evaluations", {}, body, again=False)
        return answer

    def compare(self, *, a: str, b: str) -> types.Comparison:
        """Compare evaluations of the same suite: paired on scenarios, and across trainings where there are several.

        Args:
            a: Evaluations by their ids, separated by commas: trainings of one kind that differ by their seed.
            b: The same of what they are compared with.
        """
        answer: types.Comparison = self._ask("GET", "/v1/evaluations/compare", {"a": a, "b": b}, None, again=True)
        return answer

    def show(self, evaluation: str) -> types.EvaluationFound:
        """Show an evaluation, with what it found once it is complete."""
        answer: types.EvaluationFound = self._ask("GET", f"/v1/evaluations/{_part(evaluation)}", {}, None, again=True)
        return answer

    def cancel(self, evaluation: str) -> types.Evaluation:
        """Cancel an evaluation: it is `failed`, leases of it are refused, and it is none of those under way any more. What was
        flown of it can still be looked at. Of one that is complete there is nothing to cancel (409); of one that failed
        nothing changes.
        """
        answer: types.Evaluation = self._ask("POST", f"/v1/evaluations/{_part(evaluation)}/cancel", {}, None, again=True)
        return answer

    def list_evaluation_scenarios(
        self, evaluation: str, *, limit: int | None = None, cursor: str | None = None
    ) -> types.EvaluationScenarios:
        """Show an evaluation scenario by scenario, as far as it is flown.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.EvaluationScenarios = self._ask(
            "GET", f"/v1/evaluations/{_part(evaluation)}/scenarios", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def list_suites(self) -> types.Suites:
        """List the suites that evaluations are flown on."""
        answer: types.Suites = self._ask("GET", "/v1/suites", {}, None, again=True)
        return answer


class Failures:
    """Why episodes lose score: the critique, and the failure profile of a run."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def show_critique(self, run: str, episode: str) -> types.EpisodeCritique:
        """Criticise an episode: why it lost score, and what its actions were worth. Computed from the stored actions when
        asked; it moves nothing.
        """
        answer: types.EpisodeCritique = self._ask(
            "GET", f"/v1/runs/{_part(run)}/episodes/{_part(episode)}/critique", {}, None, again=True
        )
        return answer

    def show(self, run: str, *, task: str | None = None, examples: int | None = None) -> types.Profiles:
        """Show why a run's episodes lose score: failure modes by where it came from and how fast, what actions were worth, and
        how that changes. Counted over the finished episodes of training and probes, behind the acknowledgement of results;
        late results and evaluations do not count.

        Args:
            task: One task only.
            examples: How many different episodes behind each cell are named, the newest: 0 to 64 (3). Of each cell its
                newest 64 failures are kept; where those are of fewer episodes, fewer are named.
        """
        answer: types.Profiles = self._ask(
            "GET", f"/v1/runs/{_part(run)}/failures", {"task": task, "examples": examples}, None, again=True
        )
        return answer

    def list(
        self,
        run: str,
        *,
        task: str,
        mode: str | None = None,
        sector: int | None = None,
        band: int | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Failures:
        """List the failures behind a profile, the newest first: the episodes that a cell, a sector, a mode or a whole task is
        made of.

        Args:
            task: Of this task.
            mode: Of this failure mode.
            sector: Of this bearing sector, 0 to 11.
            band: Of this speed band.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Failures = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/failures/list",
            {"task": task, "mode": mode, "sector": sector, "band": band, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer


class Health:
    """Whether the server lives and is ready."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def audit(self, *, denied: bool | None = None, limit: int | None = None, cursor: str | None = None) -> types.AuditLog:
        """Show what was changed by hand; or, with `denied=true`, who was kept out (401, 403; a line a second of an address at
        most, and ten of all). The newest 100 000 lines are kept, of who was kept out 20 000.

        Args:
            denied: Those about who was kept out, instead of what was changed (false).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.AuditLog = self._ask(
            "GET", "/v1/audit", {"denied": denied, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer


class Leases:
    """Groups of scenarios handed to a trainer for a time."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Leases:
        """List the leases of a run, oldest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Leases = self._ask(
            "GET", f"/v1/runs/{_part(run)}/leases", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def take(self, run: str, **body: Unpack[types.LeaseWish]) -> types.Lease:
        """Lease groups of scenarios. Where scenarios are still being prepared it waits a while, then answers 503."""
        answer: types.Lease = self._ask("POST", f"/v1/runs/{_part(run)}/leases", {}, body, again=False)
        return answer

    def show(self, run: str, lease: str) -> types.Lease:
        """Show a lease with its groups: what was answered when it was taken. Past what the run keeps whole only those groups
        are left that a level move, a layout or an example of a failure rests on.
        """
        answer: types.Lease = self._ask("GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}", {}, None, again=True)
        return answer

    def release(self, run: str, lease: str) -> types.LeaseHead:
        """Release a lease: what was not reported is offered again. Releasing what is over changes nothing."""
        answer: types.LeaseHead = self._ask("POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/release", {}, None, again=True)
        return answer

    def renew(self, run: str, lease: str) -> types.LeaseHead:
        """Renew a lease: it holds for its time again, from now."""
        answer: types.LeaseHead = self._ask("POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/renew", {}, None, again=True)
        return answer


class Mastery:
    """What the agent has mastered, and on what evidence."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def show(self, run: str) -> types.Masteries:
        """Show what the agent has mastered now."""
        answer: types.Masteries = self._ask("GET", f"/v1/runs/{_part(run)}/mastery", {}, None, again=True)
        return answer

    def history(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.History:
        """Show every level move with its evidence, oldest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.History = self._ask(
            "GET", f"/v1/runs/{_part(run)}/mastery/history", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def params(self, run: str) -> types.Params:
        """Show the params in force per task."""
        answer: types.Params = self._ask("GET", f"/v1/runs/{_part(run)}/params", {}, None, again=True)
        return answer

    def show_series(
        self, run: str, *, from_: str | None = None, to: str | None = None, points: int | None = None
    ) -> types.Series:
        """Show how a run went over time: success, skill, mastery, levels and params, task by task. Points are buckets of time
        in which something came back. Of the last week they are as short as a minute, of before an hour.

        Args:
            from_: Its beginning, RFC 3339 (that of the run).
            to: Its end, RFC 3339 (now).
            points: Points of each curve, at most: 1 to 2 000 (300).
        """
        answer: types.Series = self._ask(
            "GET", f"/v1/runs/{_part(run)}/series", {"from": from_, "to": to, "points": points}, None, again=True
        )
        return answer


class Results:
    """What was flown, scored by replay."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def show_columns(self, run: str, lease: str) -> types.Claim:
        """Show what was claimed of a lease, and what became of it."""
        answer: types.Claim = self._ask("GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns", {}, None, again=True)
        return answer

    def claim(self, run: str, lease: str, **body: Unpack[types.ColumnsWish]) -> types.Claim:
        """Claim how all episodes of a lease of columns went. The answer comes after the columns are on disk, and says which
        groups are audited: their logs are due, as results, within the lease's time. When all have replayed to what was
        claimed the claim is accepted; one that does not refuses it whole. The same columns again are answered as before.
        """
        answer: types.Claim = self._ask("POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns", {}, body, again=True)
        return answer

    def entries(self, run: str, lease: str) -> types.Entries:
        """Read the columns of a lease back, whatever became of them."""
        answer: types.Entries = self._ask(
            "GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns/entries", {}, None, again=True
        )
        return answer

    def report(self, run: str, **body: Unpack[types.Results]) -> types.Receipts:
        """Report results. Idempotent: what was reported before is answered as before and counts once. Each result gets its own
        answer; one that is refused does not touch the others. The answer comes after everything is on disk.
        """
        answer: types.Receipts = self._ask("POST", f"/v1/runs/{_part(run)}/results", {}, body, again=True)
        return answer


class Runs:
    """One agent's training effort each."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list(self, *, archived: bool | None = None, limit: int | None = None, cursor: str | None = None) -> types.Runs:
        """List runs, oldest first.

        Args:
            archived: Those that are archived, instead of the others (false).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Runs = self._ask(
            "GET", "/v1/runs", {"archived": archived, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def create(self, **body: Unpack[types.RunWish]) -> types.Run:
        """Create a run. Everything may be left out: `{}` is a ladder over the tasks of the first world."""
        answer: types.Run = self._ask("POST", "/v1/runs", {}, body, again=False)
        return answer

    def show(self, run: str) -> types.RunNow:
        """Show a run."""
        answer: types.RunNow = self._ask("GET", f"/v1/runs/{_part(run)}", {}, None, again=True)
        return answer

    def change(self, run: str, **body: Unpack[types.RunChange]) -> types.Run:
        """Change what a run is told; what is left out stays as it is. Tasks keep their level and mastery unless their table or
        physics change; under another strategy they keep their mastery, and the strategy starts afresh. What was proposed
        before and is leased may be reported all the same.
        """
        answer: types.Run = self._ask("PATCH", f"/v1/runs/{_part(run)}", {}, body, again=True)
        return answer

    def archive(self, run: str) -> types.Run:
        """Archive a run: it is paused, and left out of lists unless those that are archived are asked for. Resuming brings it
        back.
        """
        answer: types.Run = self._ask("POST", f"/v1/runs/{_part(run)}/archive", {}, None, again=True)
        return answer

    def show_overview(self, run: str) -> types.Overview:
        """Show a run in a glance: how much came back, how fast, where it stands."""
        answer: types.Overview = self._ask("GET", f"/v1/runs/{_part(run)}/overview", {}, None, again=True)
        return answer

    def pause(self, run: str) -> types.Run:
        """Pause a run: it grants no more leases; results of those it has granted are still taken."""
        answer: types.Run = self._ask("POST", f"/v1/runs/{_part(run)}/pause", {}, None, again=True)
        return answer

    def set_newest(self, run: str, **body: Unpack[types.Newest]) -> types.Run:
        """Set the newest policy version. Leases and results raise it by themselves; one that was named by mistake makes all
        that come after it stale (`max_staleness`) until it is set back here.
        """
        answer: types.Run = self._ask("PUT", f"/v1/runs/{_part(run)}/policy_version", {}, body, again=True)
        return answer

    def resume(self, run: str) -> types.Run:
        """Resume a run that is paused or archived."""
        answer: types.Run = self._ask("POST", f"/v1/runs/{_part(run)}/resume", {}, None, again=True)
        return answer

    def put_retention(self, run: str, **body: Unpack[types.RetentionWish]) -> types.Run:
        """Set what a run keeps whole; what is left out stays as it is. A smaller number takes effect within seconds, and what
        it lets go does not come back.
        """
        answer: types.Run = self._ask("PUT", f"/v1/runs/{_part(run)}/retention", {}, body, again=True)
        return answer

    def list_settings(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Told:
        """Show the settings of a run and those it had before, the newest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Told = self._ask(
            "GET", f"/v1/runs/{_part(run)}/settings", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def list_versions(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Versions:
        """List the versions of a run's policy, the newest first: those that were told of, and those that results came from. Of
        very many that were never told of the newest are kept.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Versions = self._ask(
            "GET", f"/v1/runs/{_part(run)}/versions", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    def put_version(self, run: str, version: str, **body: Unpack[types.VersionWish]) -> types.Version:
        """Tell of a version of the run's policy: where its weights are, and what else should be known. Telling again replaces
        what was told. A version above the newest is the newest from then on.
        """
        answer: types.Version = self._ask("PUT", f"/v1/runs/{_part(run)}/versions/{_part(version)}", {}, body, again=True)
        return answer


class Scenarios:
    """Scenarios by hand: validate, bracket, replay."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def fly(self, **body: Unpack[types.FlightWish]) -> types.Flight:
        """Fly a scenario by hand: as far as its steps go, or `until` says, or until it is over. Nothing is planned on or
        stored; `POST /v1/scenarios` judges what came of it.
        """
        answer: types.Flight = self._ask("POST", "/v1/flights", {}, body, again=True)
        return answer

    def check(self, **body: Unpack[types.Wish]) -> types.Checked:
        """Validate, bracket, replay and criticise a scenario by hand. Nothing is stored."""
        answer: types.Checked = self._ask("POST", "/v1/scenarios", {}, body, again=True)
        return answer

    def list_tasks(self) -> types.Tasks:
        """List the tasks with their parameter spaces, levels, actions, policies and failure modes."""
        answer: types.Tasks = self._ask("GET", "/v1/tasks", {}, None, again=True)
        return answer


class Tasks:
    """Tasks"""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def list_strategies(self) -> types.Strategies:
        """List the strategies with the settings of each."""
        answer: types.Strategies = self._ask("GET", "/v1/strategies", {}, None, again=True)
        return answer


class Trajectories:
    """What the server itself flies for a run: its policy, and the feed of finished groups."""

    def __init__(self, ask: Asks) -> None:
        self._ask = ask

    def show_policy(self, run: str) -> types.PolicyView:
        """Show the policy of a run: which, how it is set, and how it goes."""
        answer: types.PolicyView = self._ask("GET", f"/v1/runs/{_part(run)}/policy", {}, None, again=True)
        return answer

    def put_policy(self, run: str, **body: Unpack[types.PolicyWish]) -> types.PolicyView:
        """Set the policy of a run: which the server's workers fly for it, into its feed. `chat` asks the language model that
        the server was started with; no request can name another.
        """
        answer: types.PolicyView = self._ask("PUT", f"/v1/runs/{_part(run)}/policy", {}, body, again=True)
        return answer

    def pull(
        self, run: str, *, limit: int | None = None, wait_s: int | None = None, ttl_s: int | None = None, after: int | None = None
    ) -> types.Pulled:
        """Pull finished groups, in order. They are claimed for `ttl_s`: acknowledged in that time they are done with, else
        they are delivered again, so that each is delivered at least once; `id` tells repeats. With `after` groups are read
        again, which claims nothing. With `wait_s` an answer comes as soon as there is a group.

        Args:
            limit: How many groups at most: 1 to 256 (8). An answer is at most 32 MiB of JSON, but for a single group.
            wait_s: How long to wait where there is none, seconds: 0 to 60 (0).
            ttl_s: For how long they are nobody else's, seconds: 1 to 86 400 (600). What is not acknowledged by then is
                delivered again.
            after: Reads again what came after this id, without claiming it, whether or not it was acknowledged.
        """
        answer: types.Pulled = self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/trajectories",
            {"limit": limit, "wait_s": wait_s, "ttl_s": ttl_s, "after": after},
            None,
            again=True,
        )
        return answer

    def ack(self, run: str, **body: Unpack[types.AckWish]) -> types.Acked:
        """Acknowledge groups: they are not delivered again, and leave room for others. Doing so twice is the same as once."""
        answer: types.Acked = self._ask("POST", f"/v1/runs/{_part(run)}/trajectories/ack", {}, body, again=True)
        return answer


class Operations:
    """All of /v1, by what it is about."""

    def _begin(self, ask: Asks) -> None:
        self.designs = Designs(ask)
        self.episodes = Episodes(ask)
        self.evaluations = Evaluations(ask)
        self.failures = Failures(ask)
        self.health = Health(ask)
        self.leases = Leases(ask)
        self.mastery = Mastery(ask)
        self.results = Results(ask)
        self.runs = Runs(ask)
        self.scenarios = Scenarios(ask)
        self.tasks = Tasks(ask)
        self.trajectories = Trajectories(ask)


class AsyncDesigns:
    """Layouts designed for what the agent fails at, and asking for more."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list_layouts(
        self,
        *,
        task: str | None = None,
        state: str | None = None,
        aim: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Designs:
        """List the layouts of all runs that the gate let through, the newest first.

        Args:
            task: Of this task.
            state: In this state: `active` or `retired`.
            aim: That go for this failure mode.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Designs = await self._ask(
            "GET", "/v1/layouts", {"task": task, "state": state, "aim": aim, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def show_layout(self, layout: str) -> types.Layout:
        """Show a layout with its whole scenario, bodies included, and what it is worth."""
        answer: types.Layout = await self._ask("GET", f"/v1/layouts/{_part(layout)}", {}, None, again=True)
        return answer

    async def list(
        self,
        run: str,
        *,
        task: str | None = None,
        state: str | None = None,
        mode: str | None = None,
        ask: str | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Designs:
        """List what designers thought of for a run, the newest first: layouts that serve or served, and what the gate refused
        (at most 64 of an ask are kept; all are counted in its answer and in the summary).

        Args:
            task: Of this task.
            state: In this state: `active`, `retired` or `refused`.
            mode: That go for this failure mode.
            ask: Of this ask.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Designs = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/designs",
            {"task": task, "state": state, "mode": mode, "ask": ask, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer

    async def ask(self, run: str, **body: Unpack[types.DesignAsk]) -> types.AskView:
        """Ask a designer for layouts that go for what the agent fails at. It is answered at once, and done behind everything
        else: the ask's `state` says how far it is.
        """
        answer: types.AskView = await self._ask("POST", f"/v1/runs/{_part(run)}/designs", {}, body, again=False)
        return answer

    async def list_asks(
        self, run: str, *, task: str | None = None, state: str | None = None, limit: int | None = None, cursor: str | None = None
    ) -> types.Asks:
        """List what designers were asked for a run, the newest first.

        Args:
            task: For this task.
            state: In this state: `waiting`, `running`, `done` or `failed`.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Asks = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/designs/asks",
            {"task": task, "state": state, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer

    async def show_ask(self, run: str, ask: str) -> types.Ask:
        """Show an ask, with the failure profile it rested on."""
        answer: types.Ask = await self._ask("GET", f"/v1/runs/{_part(run)}/designs/asks/{_part(ask)}", {}, None, again=True)
        return answer

    async def summarise(self, run: str) -> types.Summary:
        """Show what was designed for a run in numbers: by state, by what the gate said, and how much of training it is."""
        answer: types.Summary = await self._ask("GET", f"/v1/runs/{_part(run)}/designs/summary", {}, None, again=True)
        return answer

    async def show(self, run: str, design: str) -> types.Design:
        """Show a design: its encounters, what the gate said, what it is worth, and how the agent fared."""
        answer: types.Design = await self._ask("GET", f"/v1/runs/{_part(run)}/designs/{_part(design)}", {}, None, again=True)
        return answer

    async def retire(self, run: str, design: str) -> types.DesignHead:
        """Retire a layout by hand: it is never served again. Groups of it that are leased already end as they would have."""
        answer: types.DesignHead = await self._ask(
            "POST", f"/v1/runs/{_part(run)}/designs/{_part(design)}/retire", {}, None, again=True
        )
        return answer

    async def revive(self, run: str, design: str) -> types.DesignHead:
        """Put a retired layout back, whyever it was retired: it serves again, and what it was retired for is forgotten."""
        answer: types.DesignHead = await self._ask(
            "POST", f"/v1/runs/{_part(run)}/designs/{_part(design)}/revive", {}, None, again=True
        )
        return answer


class AsyncEpisodes:
    """Single attempts, and their replay."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Episodes:
        """List reported episodes.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Episodes = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/episodes", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def search(
        self,
        run: str,
        *,
        task: str | None = None,
        level: int | None = None,
        state: Literal["finished", "failed", "late"] | None = None,
        success: bool | None = None,
        mode: str | None = None,
        role: Literal[
            "placement", "frontier", "rehearsal", "sample", "explore", "replay", "edit", "boundary", "designed", "suite"
        ]
        | None = None,
        layout: str | None = None,
        version: int | None = None,
        order: Literal["newest", "oldest", "worst_score", "best_score", "worst_skill", "best_skill"] | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.FoundEpisodes:
        """Look for reported episodes, of those that are kept whole: `GET …/episodes` lists all, the oldest first. Orders by
        score and skill leave out those that have none.

        Args:
            task: Of this task.
            level: Of this level.
            state: How it came back.
            success: Successes (true), or what are none (false).
            mode: In which this failure mode was found: of those that are kept as examples of it.
            role: Of groups of this role.
            layout: On this layout.
            version: Flown by this version of the policy.
            order: In which order (newest).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before, asked for with the same words.
        """
        answer: types.FoundEpisodes = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/episodes/search",
            {
                "task": task,
                "level": level,
                "state": state,
                "success": success,
                "mode": mode,
                "role": role,
                "layout": layout,
                "version": version,
                "order": order,
                "limit": limit,
                "cursor": cursor,
            },
            None,
            again=True,
        )
        return answer

    async def show(self, run: str, episode: str) -> types.Episode:
        """Show an episode: its scenario, and how it went."""
        answer: types.Episode = await self._ask("GET", f"/v1/runs/{_part(run)}/episodes/{_part(episode)}", {}, None, again=True)
        return answer

    async def replayed(
        self, run: str, episode: str, *, telemetry: bool | None = None, plan: Literal["agent", "hold", "reference"] | None = None
    ) -> types.Replay:
        """Replay an episode on the server: the whole state, step by step.

        Args:
            telemetry: Whether frames also hold what the agents saw (false).
            plan: Who flies it: the agent, as it did; nobody; or the plan that the scenario's reference score is of
                (agent).
        """
        answer: types.Replay = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/episodes/{_part(episode)}/replay",
            {"telemetry": telemetry, "plan": plan},
            None,
            again=True,
        )
        return answer


class AsyncEvaluations:
    """Evaluations"""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list(self, *, limit: int | None = None, cursor: str | None = None) -> types.Evaluations:
        """List evaluations, the newest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Evaluations = await self._ask(
            "GET", "/v1/evaluations", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def begin(self, **body: Unpack[types.EvaluationWish]) -> types.Evaluation:
        """Begin an evaluation on a frozen suite. Without `run` the server flies a built-in policy. With `run` its trainer
        flies: it leases scenarios (`purpose: eval`, `evaluation`: this id) and reports results as ever, until none is left.
        What its seeds make is never trained on.
        """
        answer: types.Evaluation = await self._ask("POST", "/v1/evaluations", {}, body, again=False)
        return answer

    async def compare(self, *, a: str, b: str) -> types.Comparison:
        """Compare evaluations of the same suite: paired on scenarios, and across trainings where there are several.

        Args:
            a: Evaluations by their ids, separated by commas: trainings of one kind that differ by their seed.
            b: The same of what they are compared with.
        """
        answer: types.Comparison = await self._ask("GET", "/v1/evaluations/compare", {"a": a, "b": b}, None, again=True)
        return answer

    async def show(self, evaluation: str) -> types.EvaluationFound:
        """Show an evaluation, with what it found once it is complete."""
        answer: types.EvaluationFound = await self._ask("GET", f"/v1/evaluations/{_part(evaluation)}", {}, None, again=True)
        return answer

    async def cancel(self, evaluation: str) -> types.Evaluation:
        """Cancel an evaluation: it is `failed`, leases of it are refused, and it is none of those under way any more. What was
        flown of it can still be looked at. Of one that is complete there is nothing to cancel (409); of one that failed
        nothing changes.
        """
        answer: types.Evaluation = await self._ask("POST", f"/v1/evaluations/{_part(evaluation)}/cancel", {}, None, again=True)
        return answer

    async def list_evaluation_scenarios(
        self, evaluation: str, *, limit: int | None = None, cursor: str | None = None
    ) -> types.EvaluationScenarios:
        """Show an evaluation scenario by scenario, as far as it is flown.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.EvaluationScenarios = await self._ask(
            "GET", f"/v1/evaluations/{_part(evaluation)}/scenarios", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def list_suites(self) -> types.Suites:
        """List the suites that evaluations are flown on."""
        answer: types.Suites = await self._ask("GET", "/v1/suites", {}, None, again=True)
        return answer


class AsyncFailures:
    """Why episodes lose score: the critique, and the failure profile of a run."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def show_critique(self, run: str, episode: str) -> types.EpisodeCritique:
        """Criticise an episode: why it lost score, and what its actions were worth. Computed from the stored actions when
        asked; it moves nothing.
        """
        answer: types.EpisodeCritique = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/episodes/{_part(episode)}/critique", {}, None, again=True
        )
        return answer

    async def show(self, run: str, *, task: str | None = None, examples: int | None = None) -> types.Profiles:
        """Show why a run's episodes lose score: failure modes by where it came from and how fast, what actions were worth, and
        how that changes. Counted over the finished episodes of training and probes, behind the acknowledgement of results;
        late results and evaluations do not count.

        Args:
            task: One task only.
            examples: How many different episodes behind each cell are named, the newest: 0 to 64 (3). Of each cell its
                newest 64 failures are kept; where those are of fewer episodes, fewer are named.
        """
        answer: types.Profiles = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/failures", {"task": task, "examples": examples}, None, again=True
        )
        return answer

    async def list(
        self,
        run: str,
        *,
        task: str,
        mode: str | None = None,
        sector: int | None = None,
        band: int | None = None,
        limit: int | None = None,
        cursor: str | None = None,
    ) -> types.Failures:
        """List the failures behind a profile, the newest first: the episodes that a cell, a sector, a mode or a whole task is
        made of.

        Args:
            task: Of this task.
            mode: Of this failure mode.
            sector: Of this bearing sector, 0 to 11.
            band: Of this speed band.
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Failures = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/failures/list",
            {"task": task, "mode": mode, "sector": sector, "band": band, "limit": limit, "cursor": cursor},
            None,
            again=True,
        )
        return answer


class AsyncHealth:
    """Whether the server lives and is ready."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def audit(self, *, denied: bool | None = None, limit: int | None = None, cursor: str | None = None) -> types.AuditLog:
        """Show what was changed by hand; or, with `denied=true`, who was kept out (401, 403; a line a second of an address at
        most, and ten of all). The newest 100 000 lines are kept, of who was kept out 20 000.

        Args:
            denied: Those about who was kept out, instead of what was changed (false).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.AuditLog = await self._ask(
            "GET", "/v1/audit", {"denied": denied, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer


class AsyncLeases:
    """Groups of scenarios handed to a trainer for a time."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Leases:
        """List the leases of a run, oldest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Leases = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/leases", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def take(self, run: str, **body: Unpack[types.LeaseWish]) -> types.Lease:
        """Lease groups of scenarios. Where scenarios are still being prepared it waits a while, then answers 503."""
        answer: types.Lease = await self._ask("POST", f"/v1/runs/{_part(run)}/leases", {}, body, again=False)
        return answer

    async def show(self, run: str, lease: str) -> types.Lease:
        """Show a lease with its groups: what was answered when it was taken. Past what the run keeps whole only those groups
        are left that a level move, a layout or an example of a failure rests on.
        """
        answer: types.Lease = await self._ask("GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}", {}, None, again=True)
        return answer

    async def release(self, run: str, lease: str) -> types.LeaseHead:
        """Release a lease: what was not reported is offered again. Releasing what is over changes nothing."""
        answer: types.LeaseHead = await self._ask(
            "POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/release", {}, None, again=True
        )
        return answer

    async def renew(self, run: str, lease: str) -> types.LeaseHead:
        """Renew a lease: it holds for its time again, from now."""
        answer: types.LeaseHead = await self._ask(
            "POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/renew", {}, None, again=True
        )
        return answer


class AsyncMastery:
    """What the agent has mastered, and on what evidence."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def show(self, run: str) -> types.Masteries:
        """Show what the agent has mastered now."""
        answer: types.Masteries = await self._ask("GET", f"/v1/runs/{_part(run)}/mastery", {}, None, again=True)
        return answer

    async def history(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.History:
        """Show every level move with its evidence, oldest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.History = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/mastery/history", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def params(self, run: str) -> types.Params:
        """Show the params in force per task."""
        answer: types.Params = await self._ask("GET", f"/v1/runs/{_part(run)}/params", {}, None, again=True)
        return answer

    async def show_series(
        self, run: str, *, from_: str | None = None, to: str | None = None, points: int | None = None
    ) -> types.Series:
        """Show how a run went over time: success, skill, mastery, levels and params, task by task. Points are buckets of time
        in which something came back. Of the last week they are as short as a minute, of before an hour.

        Args:
            from_: Its beginning, RFC 3339 (that of the run).
            to: Its end, RFC 3339 (now).
            points: Points of each curve, at most: 1 to 2 000 (300).
        """
        answer: types.Series = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/series", {"from": from_, "to": to, "points": points}, None, again=True
        )
        return answer


class AsyncResults:
    """What was flown, scored by replay."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def show_columns(self, run: str, lease: str) -> types.Claim:
        """Show what was claimed of a lease, and what became of it."""
        answer: types.Claim = await self._ask("GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns", {}, None, again=True)
        return answer

    async def claim(self, run: str, lease: str, **body: Unpack[types.ColumnsWish]) -> types.Claim:
        """Claim how all episodes of a lease of columns went. The answer comes after the columns are on disk, and says which
        groups are audited: their logs are due, as results, within the lease's time. When all have replayed to what was
        claimed the claim is accepted; one that does not refuses it whole. The same columns again are answered as before.
        """
        answer: types.Claim = await self._ask(
            "POST", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns", {}, body, again=True
        )
        return answer

    async def entries(self, run: str, lease: str) -> types.Entries:
        """Read the columns of a lease back, whatever became of them."""
        answer: types.Entries = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/leases/{_part(lease)}/columns/entries", {}, None, again=True
        )
        return answer

    async def report(self, run: str, **body: Unpack[types.Results]) -> types.Receipts:
        """Report results. Idempotent: what was reported before is answered as before and counts once. Each result gets its own
        answer; one that is refused does not touch the others. The answer comes after everything is on disk.
        """
        answer: types.Receipts = await self._ask("POST", f"/v1/runs/{_part(run)}/results", {}, body, again=True)
        return answer


class AsyncRuns:
    """One agent's training effort each."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list(self, *, archived: bool | None = None, limit: int | None = None, cursor: str | None = None) -> types.Runs:
        """List runs, oldest first.

        Args:
            archived: Those that are archived, instead of the others (false).
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Runs = await self._ask(
            "GET", "/v1/runs", {"archived": archived, "limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def create(self, **body: Unpack[types.RunWish]) -> types.Run:
        """Create a run. Everything may be left out: `{}` is a ladder over the tasks of the first world."""
        answer: types.Run = await self._ask("POST", "/v1/runs", {}, body, again=False)
        return answer

    async def show(self, run: str) -> types.RunNow:
        """Show a run."""
        answer: types.RunNow = await self._ask("GET", f"/v1/runs/{_part(run)}", {}, None, again=True)
        return answer

    async def change(self, run: str, **body: Unpack[types.RunChange]) -> types.Run:
        """Change what a run is told; what is left out stays as it is. Tasks keep their level and mastery unless their table or
        physics change; under another strategy they keep their mastery, and the strategy starts afresh. What was proposed
        before and is leased may be reported all the same.
        """
        answer: types.Run = await self._ask("PATCH", f"/v1/runs/{_part(run)}", {}, body, again=True)
        return answer

    async def archive(self, run: str) -> types.Run:
        """Archive a run: it is paused, and left out of lists unless those that are archived are asked for. Resuming brings it
        back.
        """
        answer: types.Run = await self._ask("POST", f"/v1/runs/{_part(run)}/archive", {}, None, again=True)
        return answer

    async def show_overview(self, run: str) -> types.Overview:
        """Show a run in a glance: how much came back, how fast, where it stands."""
        answer: types.Overview = await self._ask("GET", f"/v1/runs/{_part(run)}/overview", {}, None, again=True)
        return answer

    async def pause(self, run: str) -> types.Run:
        """Pause a run: it grants no more leases; results of those it has granted are still taken."""
        answer: types.Run = await self._ask("POST", f"/v1/runs/{_part(run)}/pause", {}, None, again=True)
        return answer

    async def set_newest(self, run: str, **body: Unpack[types.Newest]) -> types.Run:
        """Set the newest policy version. Leases and results raise it by themselves; one that was named by mistake makes all
        that come after it stale (`max_staleness`) until it is set back here.
        """
        answer: types.Run = await self._ask("PUT", f"/v1/runs/{_part(run)}/policy_version", {}, body, again=True)
        return answer

    async def resume(self, run: str) -> types.Run:
        """Resume a run that is paused or archived."""
        answer: types.Run = await self._ask("POST", f"/v1/runs/{_part(run)}/resume", {}, None, again=True)
        return answer

    async def put_retention(self, run: str, **body: Unpack[types.RetentionWish]) -> types.Run:
        """Set what a run keeps whole; what is left out stays as it is. A smaller number takes effect within seconds, and what
        it lets go does not come back.
        """
        answer: types.Run = await self._ask("PUT", f"/v1/runs/{_part(run)}/retention", {}, body, again=True)
        return answer

    async def list_settings(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Told:
        """Show the settings of a run and those it had before, the newest first.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Told = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/settings", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def list_versions(self, run: str, *, limit: int | None = None, cursor: str | None = None) -> types.Versions:
        """List the versions of a run's policy, the newest first: those that were told of, and those that results came from. Of
        very many that were never told of the newest are kept.

        Args:
            limit: How many at most: 1 to 500 (50).
            cursor: `next` of the page before.
        """
        answer: types.Versions = await self._ask(
            "GET", f"/v1/runs/{_part(run)}/versions", {"limit": limit, "cursor": cursor}, None, again=True
        )
        return answer

    async def put_version(self, run: str, version: str, **body: Unpack[types.VersionWish]) -> types.Version:
        """Tell of a version of the run's policy: where its weights are, and what else should be known. Telling again replaces
        what was told. A version above the newest is the newest from then on.
        """
        answer: types.Version = await self._ask("PUT", f"/v1/runs/{_part(run)}/versions/{_part(version)}", {}, body, again=True)
        return answer


class AsyncScenarios:
    """Scenarios by hand: validate, bracket, replay."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def fly(self, **body: Unpack[types.FlightWish]) -> types.Flight:
        """Fly a scenario by hand: as far as its steps go, or `until` says, or until it is over. Nothing is planned on or
        stored; `POST /v1/scenarios` judges what came of it.
        """
        answer: types.Flight = await self._ask("POST", "/v1/flights", {}, body, again=True)
        return answer

    async def check(self, **body: Unpack[types.Wish]) -> types.Checked:
        """Validate, bracket, replay and criticise a scenario by hand. Nothing is stored."""
        answer: types.Checked = await self._ask("POST", "/v1/scenarios", {}, body, again=True)
        return answer

    async def list_tasks(self) -> types.Tasks:
        """List the tasks with their parameter spaces, levels, actions, policies and failure modes."""
        answer: types.Tasks = await self._ask("GET", "/v1/tasks", {}, None, again=True)
        return answer


class AsyncTasks:
    """Tasks"""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def list_strategies(self) -> types.Strategies:
        """List the strategies with the settings of each."""
        answer: types.Strategies = await self._ask("GET", "/v1/strategies", {}, None, again=True)
        return answer


class AsyncTrajectories:
    """What the server itself flies for a run: its policy, and the feed of finished groups."""

    def __init__(self, ask: AsksLater) -> None:
        self._ask = ask

    async def show_policy(self, run: str) -> types.PolicyView:
        """Show the policy of a run: which, how it is set, and how it goes."""
        answer: types.PolicyView = await self._ask("GET", f"/v1/runs/{_part(run)}/policy", {}, None, again=True)
        return answer

    async def put_policy(self, run: str, **body: Unpack[types.PolicyWish]) -> types.PolicyView:
        """Set the policy of a run: which the server's workers fly for it, into its feed. `chat` asks the language model that
        the server was started with; no request can name another.
        """
        answer: types.PolicyView = await self._ask("PUT", f"/v1/runs/{_part(run)}/policy", {}, body, again=True)
        return answer

    async def pull(
        self, run: str, *, limit: int | None = None, wait_s: int | None = None, ttl_s: int | None = None, after: int | None = None
    ) -> types.Pulled:
        """Pull finished groups, in order. They are claimed for `ttl_s`: acknowledged in that time they are done with, else
        they are delivered again, so that each is delivered at least once; `id` tells repeats. With `after` groups are read
        again, which claims nothing. With `wait_s` an answer comes as soon as there is a group.

        Args:
            limit: How many groups at most: 1 to 256 (8). An answer is at most 32 MiB of JSON, but for a single group.
            wait_s: How long to wait where there is none, seconds: 0 to 60 (0).
            ttl_s: For how long they are nobody else's, seconds: 1 to 86 400 (600). What is not acknowledged by then is
                delivered again.
            after: Reads again what came after this id, without claiming it, whether or not it was acknowledged.
        """
        answer: types.Pulled = await self._ask(
            "GET",
            f"/v1/runs/{_part(run)}/trajectories",
            {"limit": limit, "wait_s": wait_s, "ttl_s": ttl_s, "after": after},
            None,
            again=True,
        )
        return answer

    async def ack(self, run: str, **body: Unpack[types.AckWish]) -> types.Acked:
        """Acknowledge groups: they are not delivered again, and leave room for others. Doing so twice is the same as once."""
        answer: types.Acked = await self._ask("POST", f"/v1/runs/{_part(run)}/trajectories/ack", {}, body, again=True)
        return answer


class AsyncOperations:
    """All of /v1, by what it is about."""

    def _begin(self, ask: AsksLater) -> None:
        self.designs = AsyncDesigns(ask)
        self.episodes = AsyncEpisodes(ask)
        self.evaluations = AsyncEvaluations(ask)
        self.failures = AsyncFailures(ask)
        self.health = AsyncHealth(ask)
        self.leases = AsyncLeases(ask)
        self.mastery = AsyncMastery(ask)
        self.results = AsyncResults(ask)
        self.runs = AsyncRuns(ask)
        self.scenarios = AsyncScenarios(ask)
        self.tasks = AsyncTasks(ask)
        self.trajectories = AsyncTrajectories(ask)
