"""What the API of a server takes and answers. Written by scripts/python-client: do not edit."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, TypedDict

from typing_extensions import NotRequired


class AckWish(TypedDict):
    """What a trainer has taken."""

    ids: list[int]
    """Ids of groups, at most 10 000."""


class Acked(TypedDict):
    """What became of it."""

    acked: list[int]
    """Groups that are acknowledged, now or before."""
    unknown: list[int]
    """Ids of no group of this run: never, or no longer kept."""


class ActionView(TypedDict):
    """What an action was worth."""

    agent: int
    """Whose."""
    cost: float
    """What it cost, in the world's unit of fuel."""
    gain: float
    """The score with it minus the score without it."""
    step: int
    """When, counted from 1."""
    verdict: str
    """`needed`, `harmless`, `wasteful` or `harmful`."""


class AgentEnd(TypedDict):
    """How a step ended for an agent."""

    agent: int
    """Who."""
    reward: float
    """Its own reward."""
    terminated: bool
    """It has left the episode by the rules of the task."""
    truncated: bool
    """The episode was cut off by its horizon."""


class AimView(TypedDict):
    """What a design goes for."""

    bearing_deg: NotRequired[int | None]
    """From where, degrees in the frame; none where the mode has no direction."""
    frame: NotRequired[str | None]
    """What bearings are measured in."""
    mode: str
    """The failure mode."""


All: TypeAlias = Literal["all"]
"""The word for that."""


class AskView(TypedDict):
    """One round of asking a designer."""

    admitted: int
    """How many the gate let through."""
    asked_by: str
    """`worker` (the stock ran low, or the failures changed) or `hand`."""
    cost: float
    """What they cost, in the currency that prices are configured in."""
    created_at: str
    """When it was asked, RFC 3339."""
    criticised: NotRequired[int | None]
    """Criticised episodes that the profile rests on."""
    designer: str
    """Who was asked: `llm` or `procedural`. What a language model does not do the procedural designer does."""
    ended_at: NotRequired[str | None]
    """When it ended, RFC 3339."""
    error: NotRequired[str | None]
    """Why it failed."""
    id: str
    """Its id."""
    latency_ms: int
    """How long it took, milliseconds."""
    level: NotRequired[int | None]
    """The level it was for; none before it has begun, and where there are no levels."""
    model: NotRequired[str | None]
    """The model, where one was asked."""
    prompt: NotRequired[str | None]
    """The version of its prompt."""
    refused: int
    """How many it refused."""
    rounds: int
    """Rounds, of all designers together."""
    state: str
    """`waiting`, `running`, `done` or `failed`."""
    task: str
    """The task."""
    tokens_in: int
    """Tokens in."""
    tokens_out: int
    """Tokens out."""
    troubles: list[str]
    """What went wrong without ending it, in a sentence each."""
    wanted: int
    """How many layouts were wanted."""


class Asks(TypedDict):
    """A page of asks."""

    asks: list[AskView]
    """The newest first."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class Audit(TypedDict):
    """A group whose logs are due."""

    entries: list[int]
    """Where its episodes that finished stand in the columns."""
    episodes: list[str]
    """What to report them as, one for each of these."""
    group: int
    """Its number in the lease."""


class AuditLine(TypedDict):
    """A line of the audit log."""

    address: NotRequired[str | None]
    """The address it came from."""
    at: str
    """When, RFC 3339."""
    name: NotRequired[str | None]
    """Its name."""
    operation: str
    """The operation, as this document names it."""
    path: str
    """The path that was asked for."""
    request_id: str
    """The request's id, which stands in the logs, too."""
    status: int
    """The HTTP status it was answered with."""
    token: NotRequired[int | None]
    """The number of the token; none where nobody showed one that is known."""


class AuditLog(TypedDict):
    """A page of the audit log."""

    lines: list[AuditLine]
    """The newest first."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class Backlog(TypedDict):
    """How far the critique of a run is behind its results."""

    sampling: bool
    """
    Whether so many wait that only some are criticised. The choice looks at the episode's name alone, so shares stay
    unbiased; nothing is scaled up for those that are skipped.
    """
    share: float
    """The share that is criticised now."""
    waiting: int
    """Episodes that were reported and wait for their critique."""


BandView = TypedDict(
    "BandView",
    {
        "band": int,
        "from": float,
        "to": NotRequired[float | None],
        "unit": str,
    },
)


class BracketView(TypedDict):
    """What a scenario is worth."""

    floor: float
    """The score of acting blindly."""
    hold: float
    """The score of doing nothing."""
    panel: int
    """How many blind plans there are."""
    panel_success: int
    """How many of the blind plans succeed."""
    planner: int
    """Version of the planner that made it."""
    reference: float
    """What the planner earned, with hindsight."""


class CellView(TypedDict):
    """Failures of one mode from one sector at one band of speed."""

    avoidable_share: NotRequired[float | None]
    """
    The share that acting when the body was first visible, within the fuel left, would have avoided; none where nothing
    was met.
    """
    band: NotRequired[int | None]
    """The speed band; none where nothing was met."""
    count: int
    """How many."""
    episodes: list[str]
    """The newest episodes behind it, the newest first."""
    last_at: str
    """When the last one was entered, RFC 3339."""
    mean_steps_left: NotRequired[float | None]
    """Mean steps that were left to act; none where nothing was met."""
    sector: NotRequired[int | None]
    """The bearing sector; none where nothing was met."""
    unseen_share: NotRequired[float | None]
    """The share in which the body was never visible; none where nothing was met."""
    weight: float
    """What they weigh now."""


class CheckCount(TypedDict):
    """Designs that failed one check."""

    about: str
    """What it checks."""
    check: str
    """The check."""
    count: int
    """How many."""


class Claim(TypedDict):
    """A claim, and what of it is audited."""

    audit: list[Audit]
    """The groups whose logs are replayed."""
    due: str
    """Until when the logs of what is audited are due, RFC 3339: report them as results."""
    episodes: int
    """Episodes claimed."""
    failed: int
    """Of these, failed."""
    lease: str
    """The lease."""
    policy_version: int
    """The policy that flew them."""
    state: str
    """`claimed` (logs are due), `accepted`, `refused` or `unproven` (logs never came)."""
    why: NotRequired[str | None]
    """Why it was refused."""


class ClaimedView(TypedDict):
    """What was claimed in columns."""

    episodes: int
    """Episodes of accepted claims that finished."""
    expired: int
    """Episodes that were leased and never claimed."""
    failed: int
    """Episodes of accepted claims that failed."""
    refused: int
    """Episodes of claims that were refused."""
    score: NotRequired[float | None]
    """Their mean score, as claimed."""
    unproven: int
    """Episodes of claims whose audited logs never came."""


class ColumnsWish(TypedDict):
    """One entry for each episode of the lease, in order. In MessagePack a column may also be `bin`: little-endian, without gaps."""

    failed: NotRequired[list[int] | None]
    """1 where the infrastructure lost it, else 0; left out where none was lost. `bin`: u8."""
    policy_version: NotRequired[int | None]
    """The policy that flew them (the lease's)."""
    score: list[float]
    """The score of each; of those that failed it is not looked at, but must be a number. `bin`: f32."""
    steps: NotRequired[list[int] | None]
    """Steps flown, if you like. `bin`: u32."""


DesignerChoice: TypeAlias = Literal["auto", "llm", "procedural", "off"]
"""Who designs for a run."""


class DesignerSummary(TypedDict):
    """What a designer was asked, and what it took."""

    asks: int
    """Asks."""
    cost: float
    """What they cost."""
    designer: str
    """`llm` or `procedural`."""
    failed: int
    """Those that failed."""
    tokens_in: int
    """Tokens in."""
    tokens_out: int
    """Tokens out."""


class Entries(TypedDict):
    """What was claimed, as it came."""

    failed: list[int]
    """1 where it failed; empty where none did."""
    score: list[float]
    """The score of each episode of the lease."""
    state: str
    """`claimed`, `accepted`, `refused` or `unproven`."""
    steps: list[int]
    """Steps flown; empty where nothing was said of them."""


class Evaluation(TypedDict):
    """An evaluation without its numbers."""

    chance: bool
    """Whether these differ by chance."""
    completed_at: NotRequired[str | None]
    """When the last scenario was flown, RFC 3339."""
    created_at: str
    """When it was begun, RFC 3339."""
    flown: int
    """Of these, flown."""
    id: str
    """Its id."""
    name: str
    """Its name for people."""
    policy: str
    """The policy."""
    reflown: int
    """
    How often scenarios were offered again because a group that flew them lost episodes or its lease ended first. What such groups
    did is in no number here: where there are many of them, see that it is not the bad ones that get lost.
    """
    rollouts: int
    """Episodes of each scenario."""
    run: NotRequired[str | None]
    """The run whose trainer flies it; none: the server does."""
    scenarios: int
    """Scenarios that are to be flown."""
    state: str
    """`open` (its trainer leases scenarios), `flying` (the server does), `complete` or `failed`."""
    suite: str
    """The suite."""
    suite_hash: str
    """Its hash: evaluations of the same compare."""
    tasks: NotRequired[list[str] | None]
    """The tasks of it that are flown; none: all."""
    training: NotRequired[str | None]
    """What trainings of one kind are called together."""
    training_seed: NotRequired[int | None]
    """By what this one differs from them."""
    trouble: NotRequired[str | None]
    """Why it failed."""
    version: NotRequired[int | None]
    """The version of the run's policy."""


class EvaluationFound(Evaluation):
    """An evaluation."""

    rows: list[dict[str, Any]]
    """
    What was found, once it is complete, beside the plans that look at nothing (`blind_panel`): for each task and part `{task, part,
    policy, scenarios, score, success, skill, lost, fuel_used, cvar10}`, the last six as `{mean, low, high, scenarios}`, 95 % bootstrap
    intervals over scenarios.
    """


class EvaluationScenario(TypedDict):
    """How a policy fared on one scenario."""

    episodes: int
    """Episodes that were flown; 0 until they are."""
    floor: float
    """What is reached where nobody acts."""
    fuel_used: NotRequired[float | None]
    """The fuel that they used on average, all agents together."""
    level: int
    """The level it was drawn at."""
    lost: NotRequired[float | None]
    """The share of agents that were lost."""
    part: str
    """`contested` or `as_they_come`."""
    place: int
    """Its place in the suite: of evaluations of one suite the same is the same scenario."""
    reference: float
    """What the reference reaches."""
    scenario_id: str
    """Its id."""
    score: NotRequired[float | None]
    """Their mean score."""
    skill: NotRequired[float | None]
    """Their mean skill, where it is defined."""
    success: NotRequired[float | None]
    """Their share of successes."""
    task: str
    """The task."""


class EvaluationScenarios(TypedDict):
    """A page of an evaluation's scenarios."""

    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""
    scenarios: list[EvaluationScenario]
    """In the suite's order."""


class EvaluationWish(TypedDict):
    """An evaluation as it is asked for."""

    chance: NotRequired[bool | None]
    """Whether these differ by chance: a trainer's do unless told (a built-in policy is known)."""
    name: NotRequired[str | None]
    """A name for people (the policy's)."""
    policy: str
    """Without `run`, a built-in policy that every task of the suite has: the server flies it. With `run`, whatever you call yours."""
    rollouts: NotRequired[int | None]
    """Episodes of each scenario: 1 to 1 024 (1; 8 where the policy has chance in it)."""
    run: NotRequired[str | None]
    """The run whose trainer flies it, in leases with `purpose: eval` and this evaluation's id."""
    seed: NotRequired[int | None]
    """What a built-in policy with chance in it draws from (0)."""
    suite: NotRequired[str | None]
    """A suite that comes with the program (kessler-heldout-v2)."""
    tasks: NotRequired[list[str] | None]
    """Only its scenarios of these tasks (all), for a policy that flies no others. Needs `run`: the server flies whole suites."""
    training: NotRequired[str | None]
    """What trainings of one kind that differ by their seed are called together."""
    training_seed: NotRequired[int | None]
    """By what this one differs from them."""
    version: NotRequired[int | None]
    """The version of the run's policy (the newest)."""


class Evaluations(TypedDict):
    """A page of evaluations."""

    evaluations: list[Evaluation]
    """The newest first."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


EvidenceFrom: TypeAlias = Literal["train", "probe"]
"""Which leases' outcomes move mastery."""


class FailureHead(TypedDict):
    """One failure."""

    agent: int
    """Whose."""
    avoidable: NotRequired[bool | None]
    """Whether acting then would have avoided it; none if nothing was met, or it was never visible."""
    band: NotRequired[int | None]
    """The speed band; none where nothing was met."""
    bearing_deg: NotRequired[float | None]
    """Degrees from radial out towards in-track."""
    episode: str
    """The episode."""
    mode: str
    """The failure mode."""
    relative_speed: NotRequired[float | None]
    """In the world's unit of speed."""
    sector: NotRequired[int | None]
    """The bearing sector; none where nothing was met."""
    step: int
    """When, counted from 1."""
    steps_left: NotRequired[int | None]
    """Steps that were left to act."""


class Failures(TypedDict):
    """A page of failures."""

    failures: list[FailureHead]
    """The newest first; of each cell of the profile the last 64 are kept."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class FeedView(TypedDict):
    """How full a feed is."""

    acked: int
    """Groups acknowledged that can still be read again."""
    bytes: int
    """Bytes of those that are not acknowledged, as stored."""
    delivered: int
    """Groups delivered, their time not over."""
    full: bool
    """Nothing more is flown until some are acknowledged."""
    waiting: int
    """Groups that wait to be delivered."""


class Flight(TypedDict):
    """How far it came."""

    done: bool
    """Whether the episode is over."""
    frames: list[dict[str, Any]]
    """
    Frames from `from` on, the last one of the step that it came to; that one alone where it was over before `from`: `step`, `actions`, `reward`, `done`, `state` (the
    truth) and `observation` (what the agents saw).
    """
    horizon: int
    """Steps after which it is cut off."""
    scenario: dict[str, Any]
    """The scenario, complete."""
    scenario_id: str
    """The scenario's id."""


FlightWish = TypedDict(
    "FlightWish",
    {
        "from": NotRequired[int],
        "scenario": dict[str, Any],
        "steps": NotRequired[list[list[list[Any]]]],
        "until": NotRequired[int],
    },
)


class FlownView(TypedDict):
    """How the agent fared on a layout."""

    as_aimed: NotRequired[float | None]
    """Of the criticised episodes in which something went wrong, the share in which the aimed failure mode did."""
    episodes: int
    """Episodes of these that finished."""
    groups: int
    """Groups leased."""
    outcomes: int
    """Groups that came back."""
    recent: list[float]
    """The last outcomes since it began or came back, the oldest first: shares of success, at most 16."""
    regret: NotRequired[float | None]
    """Mean of what was left on the table: (reference − score)/(reference − floor) within 0 to 1."""
    score: NotRequired[float | None]
    """Mean score."""
    success: NotRequired[float | None]
    """successes / episodes."""
    successes: int
    """Of these, successes."""


Form: TypeAlias = Literal["groups", "columns"]
"""How a lease's episodes are named and reported."""


class Group(TypedDict):
    """Episodes of one scenario. Everything but recipe and seed is for the trainer, never for the agent."""

    bracket: NotRequired[BracketView | None]
    contested: bool
    """Whether acting well matters on this scenario."""
    episodes: list[str]
    """What to report them as."""
    group: int
    """Its number in the lease."""
    layout: NotRequired[str | None]
    """The layout's id, where it was designed."""
    level: NotRequired[int | None]
    """The level."""
    recipe: int
    """Index into `recipes`."""
    role: str
    """`placement`, `frontier`, `rehearsal`, `sample`, `explore`, `replay`, `edit`, `boundary`, `designed` or `suite`."""
    scenario: str
    """The scenario's id."""
    seed: int
    """The seed that makes the recipe a scenario."""
    state: str
    """`open`, `complete`, `partial` or `lost`."""
    task: str
    """The task."""
    train: bool
    """Whether to learn from it: some curricula only want to know how it goes."""


class GroupEnd(TypedDict):
    """A group that closed."""

    expired: int
    """Episodes that never came back."""
    failed: int
    """Episodes that failed."""
    finished: int
    """Episodes that finished."""
    group: int
    """Its number there."""
    lease: str
    """Its lease."""
    mean_score: NotRequired[float | None]
    """Mean score of those that finished."""
    state: str
    """`complete` (all of its episodes finished), `partial` (`min_group` or more of them did) or `lost`."""
    successes: int
    """Of those that finished, successes."""
    zero_variance: NotRequired[bool | None]
    """
    Whether all that finished have the same score, so that there is nothing to learn from their differences; left out where fewer
    than two finished.
    """


class Groups(TypedDict):
    """How groups of several episodes ended, at all levels together."""

    complete: int
    """All of their episodes finished."""
    lost: int
    """Fewer finished."""
    partial: int
    """`min_group` or more of them finished."""
    zero_variance: int
    """
    Of the complete and partial ones, those whose episodes all have the same score: there is nothing to learn from their
    differences.
    """
    zero_variance_share: NotRequired[float | None]
    """zero_variance / (complete + partial)."""


class Health(TypedDict):
    """How the server is."""

    status: str
    """`ok`."""


class InertialView(TypedDict):
    """Failures of one mode from one inertial sector."""

    count: int
    """How many."""
    sector: int
    """The sector."""
    weight: float
    """What they weigh now."""


class JudgedView(TypedDict):
    """The deterministic judge's word."""

    case: str
    """Which of the judge's cases it is."""
    value: float
    """Within −1 to 1."""
    words: str
    """The same in one sentence."""


Keep: TypeAlias = int | All
"""How many episodes are kept whole."""


class Last(TypedDict):
    """What happened last."""

    at: str
    """When, RFC 3339."""
    kind: str
    """The kind of event."""


class LeaseHead(TypedDict):
    """A lease without its groups."""

    created_at: str
    """When it was granted, RFC 3339."""
    expires_at: str
    """Until when it holds, RFC 3339."""
    form: str
    """`groups` or `columns`."""
    group_size: int
    """Episodes in each."""
    groups: int
    """How many groups."""
    lease: str
    """Its id."""
    purpose: str
    """What it is for."""
    status: str
    """`active`, `done`, `released` or `expired`."""


class Leases(TypedDict):
    """A page of leases."""

    leases: list[LeaseHead]
    """Oldest first."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class LevelTable(TypedDict):
    """A table of levels as it is sent."""

    columns: list[str]
    """Names of params."""
    rows: list[list[float]]
    """One row a level, easy to hard."""


class Mark(TypedDict):
    """A mark."""

    at: str
    """When, RFC 3339."""
    kind: str
    """`refused_claim`: a trainer's columns said other than its logs."""
    lease: NotRequired[str | None]
    """The lease that it is about."""
    words: str
    """A sentence."""


class Marks(TypedDict):
    """What somebody should know of a run."""

    count: int
    """How many there are."""
    newest: list[Mark]
    """The newest first, at most 20."""


class MeasureView(TypedDict):
    """A number with its name and unit."""

    name: str
    """What it is."""
    unit: str
    """Its unit, empty for a pure number."""
    value: float
    """How much."""


class Metrics(TypedDict):
    """What a trainer may log of an episode."""

    invalid_actions: NotRequired[int | None]
    """Answers that were no action."""
    max_mc: NotRequired[float | None]
    """Its MaxMC regret: the same under `score: max_mc`."""
    positive_value_loss: NotRequired[float | None]
    """Mean positive value loss over its steps: what `plr` and its kin go by under `score: positive_value_loss`."""
    temperature: NotRequired[float | None]
    """Sampling temperature."""
    tokens_in: NotRequired[int | None]
    """Prompt tokens."""
    tokens_out: NotRequired[int | None]
    """Completion tokens."""
    truncated: NotRequired[bool | None]
    """An answer was cut off."""


class ModelMetrics(TypedDict):
    """What is remembered of an episode, by the names under which trainers log it."""

    invalid_actions: int
    """Answers that were no action."""
    temperature: NotRequired[float | None]
    """Sampling temperature."""
    tokens_in: int
    """Prompt tokens."""
    tokens_out: int
    """Completion tokens."""
    truncated: bool
    """An answer was cut off."""


MoveView = TypedDict(
    "MoveView",
    {
        "at": str,
        "evidence": dict[str, Any],
        "from": NotRequired[int | None],
        "kind": str,
        "seq": int,
        "task": str,
        "to": int,
    },
)


class Newest(TypedDict):
    """The newest policy version as it should be."""

    policy_version: int
    """The version."""


Observations: TypeAlias = Literal["telemetry", "none"]
"""What is kept of observations."""


class ParamSeries(TypedDict):
    """A param over time."""

    high: list[float | None]
    """The most."""
    low: list[float | None]
    """The least."""
    mean: list[float | None]
    """Its mean."""


class Params(TypedDict):
    """The params in force, by task."""

    tasks: dict[str, dict[str, float]]
    """By task's id."""


class Plain(TypedDict):
    """Plain counts over all episodes."""

    episodes: int
    """Episodes that finished."""
    expired: int
    """Episodes that expired."""
    failed: int
    """Episodes that failed."""
    score: NotRequired[float | None]
    """Mean score."""
    skill: NotRequired[float | None]
    """Mean skill, where scenarios define one."""
    success: NotRequired[float | None]
    """successes / episodes."""
    successes: int
    """Of these, successes."""


class Point(TypedDict):
    """A stretch of a task's evidence."""

    at: str
    """When it ended, RFC 3339."""
    levels: NotRequired[list[int] | None]
    """The levels in it, lowest and highest."""
    n: int
    """Contested scenarios in it."""
    success: float
    """Mean of their success shares."""
    task: str
    """The task."""


class PolicySettings(TypedDict):
    """The same, complete, as stored."""

    ahead: int
    """Groups that may wait in the feed unacknowledged."""
    history: int
    """Exchanges that a `chat` model is told again."""
    max_tokens: NotRequired[int | None]
    """Tokens of one answer of `chat`; none: as the server was started."""
    observations: Observations
    """Whether trajectories have what the agents saw."""
    refill: NotRequired[bool]
    """Whether groups whose episodes all have the same score are kept out of the feed."""
    temperature: NotRequired[float | None]
    """Sampling temperature of `chat`; none: the endpoint's own."""


class PolicyWish(TypedDict):
    """The policy of a run, as it is asked for. What is left out is at its default, not as it was; but for `version`."""

    ahead: NotRequired[int | None]
    """Groups that may wait in the feed unacknowledged, 1 to 4 096 (32). Nothing is flown beyond."""
    history: NotRequired[int | None]
    """Exchanges that a `chat` model is told again, 0 to 64 (2)."""
    max_tokens: NotRequired[int | None]
    """Tokens of one answer of `chat`, 16 to 131 072 (what the server was started with)."""
    observations: NotRequired[Observations | None]
    policy: str
    """
    `off`, `chat` (the language model that the server was started with), or a built-in policy that every task of the run
    has (`GET /v1/tasks` lists them).
    """
    refill: NotRequired[bool | None]
    """Whether groups whose episodes all have the same score are kept out of the feed, and others flown in their place (false)."""
    temperature: NotRequired[float | None]
    """Sampling temperature of `chat`, 0 to 5 (what the server was started with, else the endpoint's own)."""
    version: NotRequired[int | None]
    """
    Its version: raised once new weights are behind the endpoint. Groups begun later carry it. It never goes down; left
    out it stays as it is.
    """


class Posterior(TypedDict):
    """Beta(1, 1) and the last 64 contested scenarios."""

    level: NotRequired[int | None]
    """The level."""
    mean: float
    """Mean."""
    n: int
    """Scenarios it rests on."""
    q10: float
    """10 % quantile."""
    q90: float
    """90 % quantile."""
    seen: int
    """Scenarios seen since the run began."""


PrecisionWord: TypeAlias = Literal["f32", "f64"]


class Problem(TypedDict):
    """What went wrong, for programs and for people."""

    detail: str
    """One sentence about this occurrence."""
    field: NotRequired[str | None]
    """The field at fault, as a dotted path."""
    status: int
    """The HTTP status."""
    title: str
    """The HTTP status in words."""
    type: str
    """A URN that names the kind of problem."""


Purpose: TypeAlias = Literal["train", "probe", "eval"]
"""What a lease is for."""


class Range(TypedDict):
    """
    Groups of a lease of columns that share a recipe: group `first + i` has the seed `seed + i`, for i below `groups`; its episodes
    are the lease's from `(first + i) × group_size` on, named `ep_<lease>_<index>`.
    """

    first: int
    """The number of its first group."""
    groups: int
    """How many groups."""
    level: NotRequired[int | None]
    """The level."""
    recipe: int
    """Index into `recipes`."""
    role: str
    """`placement`, `frontier`, `rehearsal` or `sample`."""
    seed: int
    """The seed of the first; each next has the next."""
    task: str
    """The task."""


class Receipt(TypedDict):
    """What became of one reported episode."""

    code: NotRequired[str | None]
    """
    Why it was refused: `bad_id`, `unknown_episode`, `foreign_episode`, `invalid_result` (its fields), `invalid_log`,
    `conflict`, `other_version` (an evaluation is of one), `expired` (past what the run keeps whole, and never reported), `not_as_claimed` (its columns said otherwise, and are refused).
    """
    detail: NotRequired[str | None]
    """The same for people."""
    episode: str
    """The episode, as it was written."""
    score: NotRequired[float | None]
    """The score, by replay."""
    skill: NotRequired[float | None]
    """The skill, where the scenario defines one."""
    status: str
    """
    `counted` (its group can move the curriculum: mastery, or what the strategy keeps), `stored` (kept as a statistic: an evaluation, a designed
    layout, or too old a policy), `audited` (as its columns claim; it counts once all that is audited is),
    `failed`, `late` (its lease was over), `duplicate` (reported before, the same), `refused`.
    """
    success: NotRequired[bool | None]
    """Whether it is a success, by the run's rule."""


class Refill(TypedDict):
    """Groups that a lease was given in place of others: show the lease to have them."""

    groups: list[int]
    """Their numbers there."""
    lease: str
    """The lease."""


class RemedyView(TypedDict):
    """An action that would have helped."""

    cost: float
    """What it costs, in the world's unit of fuel."""
    step: int
    """When, counted from 1."""
    values: list[float]
    """Its values, as the task's action space has them."""


class Replay(TypedDict):
    """A replay, step by step."""

    episode: str
    """The episode."""
    frames: list[dict[str, Any]]
    """
    The start, then one frame a step: actions, rewards, and the whole state, hidden bodies included; with
    `telemetry=true` also `observation`, what the agents saw.
    """
    scenario: dict[str, Any]
    """The scenario, complete."""


Replayable: TypeAlias = Literal["available", "expired", "none"]
"""Whether the actions of an episode are there to be replayed."""


class RetentionWish(TypedDict):
    """What a run should keep whole: a number of episodes, or `all`."""

    claimed: NotRequired[Keep | None]
    episodes: NotRequired[Keep | None]


class Run(TypedDict):
    """A run."""

    archived_at: NotRequired[str | None]
    """When it was archived, RFC 3339."""
    created_at: str
    """When it was made, RFC 3339."""
    id: str
    """Its id."""
    name: str
    """Its name for people."""
    policy_version: int
    """The newest policy version a trainer reported."""
    seed: int
    """The seed of its random streams."""
    settings: dict[str, Any]
    """Its settings, complete."""
    status: str
    """`active` or `paused`."""


class RunNow(Run):
    """A run, and how far what happens behind the acknowledgement has come."""

    critique: Backlog
    """How far the critique is behind."""
    marks: Marks
    """What somebody should know before trusting it: how much, and the newest."""


class Runs(TypedDict):
    """A page of runs."""

    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""
    runs: list[Run]
    """Oldest first."""


class SectorView(TypedDict):
    """A bearing sector."""

    bearing_deg: float
    """Its centre; it reaches 15° to either side."""
    sector: int
    """Its number."""


class Setting(TypedDict):
    """A setting of a strategy."""

    about: str
    """What it does."""
    default: float | str
    """What it is unless told."""
    name: str
    """Its name."""
    source: str
    """Where that comes from."""
    takes: str
    """What it takes, in words."""


class Settings(TypedDict):
    """The settings of a run from a moment on."""

    at: str
    """Since when, RFC 3339."""
    nth: int
    """The how-manieth, from 0."""
    settings: dict[str, Any]
    """All of them, as they were written down then."""


class Side(TypedDict):
    """One side."""

    across: dict[str, Any]
    """
    Interquartile means over its trainings of their mean score, success and skill on the suite: `{trainings, score, success, skill}`,
    95 % bootstrap intervals over trainings. Those of fewer than three say little.
    """
    evaluations: list[str]
    """Its evaluations."""


Status: TypeAlias = Literal["finished", "failed"]


StoppedWord: TypeAlias = Literal["unparsable", "too_long", "too_late"]


class StoredFlown(TypedDict):
    """How a plan or an episode fared, as stored and sent."""

    fuel_used: float
    """Fuel spent by all agents."""
    goal: NotRequired[float | None]
    """How well the task's goal was held towards the end, where it has one."""
    lost: int
    """Agents lost."""
    score: float
    """The world's score."""
    steps: int
    """Steps flown."""
    total: float
    """The sum of rewards, as the wire shows it."""


class Strategy(TypedDict):
    """One strategy."""

    about: str
    """What it does, in a few words."""
    columns: bool
    """Whether its episodes can be leased as columns: not where it faces single scenarios again."""
    name: str
    """Its name."""
    settings: list[Setting]
    """The settings of its own: `strategy_settings` of a run."""


SuccessSetting: TypeAlias = Literal["task", "raw"]
"""When an episode is a success."""


class SuiteView(TypedDict):
    """A suite."""

    hash: str
    """Its hash: evaluations of the same compare."""
    name: str
    """Its name."""
    policies: list[str]
    """The built-in policies that every one of its tasks has: the server flies them."""
    scenarios: int
    """Its scenarios."""
    tasks: list[str]
    """Their tasks."""


class Suites(TypedDict):
    """All suites."""

    suites: list[SuiteView]
    """The newest of each world first."""
    usual: str
    """The one that is meant where nobody says which."""


class Task(TypedDict):
    """One task, as data."""

    about: str
    """One sentence."""
    actions: dict[str, Any]
    """What an agent does in a step."""
    agents: int
    """Agents at the start, at default params."""
    failure_modes: list[dict[str, Any]]
    """Why an episode can lose score."""
    horizon: int
    """Steps after which an episode is cut off, at default params."""
    id: str
    """`world/task`."""
    levels: dict[str, Any]
    """The table of levels."""
    params: list[dict[str, Any]]
    """The parameter space."""
    physics: list[dict[str, Any]]
    """The physics options."""
    policies: list[dict[str, Any]]
    """The built-in policies: name, what each does, and whether its actions are drawn."""
    reflex: list[str]
    """Names of the numbers of the trainable reflex, each within 0 to 1."""
    score: dict[str, Any]
    """The range of the score."""
    speed_bands: dict[str, Any]
    """How relative speeds are sorted: the upper edges of all bands but the last."""
    world: str
    """The world and its version."""


class TaskGlance(TypedDict):
    """A task in a glance."""

    level: NotRequired[int | None]
    """Its level; none where there are none, and during placement."""
    mastery: NotRequired[float | None]
    """The posterior over success on contested scenarios there: its mean; none before there is evidence."""
    mastery_high: NotRequired[float | None]
    """Its 90 % quantile."""
    mastery_low: NotRequired[float | None]
    """Its 10 % quantile."""
    task: str
    """The task."""


class TaskMastery(TypedDict):
    """One task."""

    claimed: ClaimedView
    """What was claimed in columns: statistics, but for the groups that were audited, which count above."""
    designed: Plain
    """The same of designed layouts, which are made to be failed."""
    groups: Groups
    """How groups of several episodes ended; all zeros where groups have one."""
    level: NotRequired[int | None]
    """The current level; none during placement, and where the strategy has no levels."""
    levels: list[Posterior]
    """The same at every level with evidence."""
    mastery: NotRequired[Posterior | None]
    params: dict[str, float]
    """The params in force: of the current level, or of the one that is probed."""
    placed: bool
    """Whether the level was found."""
    plain: Plain
    """Success over all episodes, contested or not, but those of designed layouts."""
    probing: NotRequired[int | None]
    """The level that placement probes now."""
    status: dict[str, Any]
    """How full the current block is, what it takes to move."""
    task: str
    """The task."""
    warnings: list[str]
    """What somebody should know."""


class TaskSeries(TypedDict):
    """Columns over time, all of one length. What nothing is known of is null."""

    at: list[int]
    """Where each point begins, seconds since 1970."""
    claimed: list[int]
    """Episodes claimed in columns, and accepted."""
    contested: list[float | None]
    """Mean success on contested scenarios."""
    contested_n: list[int]
    """How many contested scenarios that rests on."""
    episodes: list[int]
    """Episodes that finished."""
    high: list[int | None]
    """The highest."""
    level: list[int | None]
    """The level at the end of the point."""
    lost: list[int]
    """Episodes that failed or never came back."""
    low: list[int | None]
    """The lowest level of what came back."""
    mastery: list[float | None]
    """The posterior over success on contested scenarios of that level, then: its mean."""
    mastery_high: list[float | None]
    """Its 90 % quantile."""
    mastery_low: list[float | None]
    """Its 10 % quantile."""
    panel: list[float | None]
    """Mean success of the plans that look at nothing, on some of those scenarios."""
    params: dict[str, ParamSeries]
    """The params of what came back."""
    score: list[float | None]
    """Mean score over all episodes."""
    skill: list[float | None]
    """Mean skill where scenarios define one."""
    success: list[float | None]
    """Share of successes over all episodes."""
    task: str
    """The task."""
    zero_variance: list[float | None]
    """Share of the groups of several episodes whose episodes all have the same score."""


class TaskSummary(TypedDict):
    """What was designed for a task."""

    active: int
    """Layouts that serve."""
    admitted: int
    """Designs that the gate let through."""
    refused: list[CheckCount]
    """Designs that it refused, by its checks in their order; those that are not kept are counted too."""
    retired: dict[str, int]
    """Layouts that are retired, by why: `mastered`, `hopeless`, `hand`."""
    task: str
    """The task."""


class TaskWish(TypedDict):
    """What is special about one task of a run."""

    levels: NotRequired[LevelTable | None]
    physics: NotRequired[dict[str, str]]
    """
    The physics it is flown by at every level, as `physics` in a scenario: options by name, those left out at their
    defaults. `GET /v1/tasks` lists them.
    """
    success_threshold: NotRequired[float | None]
    """The score that is a success under `success: raw` (0.7)."""
    weight: NotRequired[float | None]
    """Its share against the others' (1); each task gets at least 5 %."""


class Tasks(TypedDict):
    """All tasks."""

    tasks: list[Task]
    """World by world."""


class Told(TypedDict):
    """A page of settings."""

    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""
    settings: list[Settings]
    """The newest first."""


class TrajectoryStep(TypedDict):
    """One step of an episode."""

    action: NotRequired[list[list[float]] | None]
    """
    What they did, as results have it: a list of `[agent, value, …]`. None where the agent gave none: the episode was
    stopped there.
    """
    agents: list[AgentEnd]
    """Every agent that was alive before it."""
    completions: NotRequired[list[dict[str, Any]] | None]
    """How a language model came to it: one call, or two where its first answer was repaired."""
    done: bool
    """The episode is over."""
    error: NotRequired[str | None]
    """Why the agent gave no action."""
    observation: NotRequired[dict[str, Any] | None]
    """What the agents were told before it, in the wire form."""
    reward: float
    """The team's reward. Of the step at which the episode was stopped: all that doing nothing earned from there on."""


class Trend(TypedDict):
    """A mean or share: lately, and over all."""

    all: float
    """Over all criticised episodes."""
    now: float
    """Over the recent episodes: weighted."""


class TroubleView(TypedDict):
    """Something that went wrong."""

    at: str
    """When, RFC 3339."""
    words: str
    """What, in a sentence."""


class TurnView(TypedDict):
    """A change of a design's state."""

    at: str
    """When, RFC 3339."""
    reason: str
    """Why."""
    state: str
    """The state from then on."""


class VerdictView(TypedDict):
    """Actions with one verdict."""

    count: int
    """How many."""
    per_episode: NotRequired[Trend | None]
    verdict: str
    """`needed`, `harmless`, `wasteful` or `harmful`."""


class VersionTask(TypedDict):
    """How a version fared on a task."""

    episodes: int
    """Episodes that finished."""
    first_at: str
    """When the first came in, RFC 3339."""
    last_at: str
    """When the last did, RFC 3339."""
    score: float
    """Mean score."""
    success: float
    """successes / episodes."""
    successes: int
    """Of these, successes."""
    task: str
    """The task."""


class VersionWish(TypedDict):
    """What a version of a policy is."""

    checkpoint: NotRequired[str | None]
    """Where its weights are, in your own words: a path, an address, a commit."""
    notes: NotRequired[str | None]
    """Whatever else should be known of it."""


class Actions(TypedDict):
    """An action log."""

    precision: NotRequired[PrecisionWord]
    """`f32` or `f64` (default): the precision the actions were taken in."""
    steps: list[list[list[Any]]]
    """
    One entry a step, the first step's first, in the task's own form: a list of `[agent, value, …]` with the values of its action space, as
    `[satellite, dvx, dvy]` for kessler. An agent without an entry goes on as it is.
    """
    stopped: NotRequired[StoppedWord | None]


class Ask(AskView):
    """An ask with what it rested on."""

    profile: NotRequired[dict[str, Any] | None]
    """The failure profile as it stood; none before it has begun."""


class Comparison(TypedDict):
    """One side against the other."""

    a: Side
    """One side."""
    b: Side
    """The other."""
    rows: list[dict[str, Any]]
    """
    The first against the other on the same scenarios, trainings of a side taken together: for each task and part `{task, part,
    scenarios, score, success, skill, improvement}`, the last four as `{mean, low, high, scenarios}`, 95 % bootstrap intervals over
    scenarios. `improvement` is how likely an episode of the first scores higher, ties counting one half.
    """
    suite: str
    """The suite of all of them."""


class DesignAsk(TypedDict):
    """What is asked. Everything may be left out."""

    designer: NotRequired[DesignerChoice | None]
    n: NotRequired[int | None]
    """How many layouts: 1 to 32 (the run's stock)."""
    task: NotRequired[str | None]
    """For which of the run's tasks (the one whose failures weigh most)."""


class DesignHead(TypedDict):
    """A design in a list."""

    aim: NotRequired[AimView | None]
    ask: str
    """The ask it came of."""
    claim: NotRequired[str | None]
    """`threat` or `decoy`; none where it was refused."""
    created_at: str
    """When it was made, RFC 3339."""
    designer: str
    """Who thought of it: `llm` or `procedural`."""
    flown: FlownView
    """How the agent fared."""
    id: str
    """Its id."""
    level: NotRequired[int | None]
    """The level it was designed at; none where the strategy has no levels."""
    name: str
    """Its name, in its designer's words."""
    novelty: NotRequired[float | None]
    """How far the nearest design was that was known before it, 0 to 1; none where it was the first."""
    reason: NotRequired[str | None]
    """The gate's sentence, where it was refused."""
    retired_at: NotRequired[str | None]
    """When it was retired, RFC 3339."""
    round: int
    """In which round: 1, and one more for every repair."""
    run: str
    """The run."""
    served_at: NotRequired[str | None]
    """When it was leased last, RFC 3339."""
    state: str
    """`active`, `retired` or `refused`."""
    task: str
    """The task."""
    why: NotRequired[str | None]
    """Why it is retired (`mastered`, `hopeless` or `hand`), or which check of the gate refused it."""


class DesignWish(TypedDict):
    """Layouts designed for the agent's failures, as a run asks for them. Everything may be left out."""

    designer: NotRequired[DesignerChoice | None]
    evidence: NotRequired[bool | None]
    """
    Whether outcomes of designed groups move levels and mastery (false). Then those of threats that were designed at the
    current level do.
    """
    layout_share: NotRequired[float | None]
    """The share of training groups that one layout may take, above 0, at most 1 (0.05); four groups it may always take."""
    share: NotRequired[float | None]
    """
    The share of training groups that are designed, 0 to 1 (0.3), once there are failures to design for and the task's
    placement is over. 0: nothing is designed.
    """
    stock: NotRequired[int | None]
    """How many active layouts near the current level of a task are kept in stock: 1 to 64 (8)."""


class Designs(TypedDict):
    """A page of designs."""

    designs: list[DesignHead]
    """The newest first."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class EncounterView(TypedDict):
    """The geometry of a meeting."""

    avoidable: NotRequired[bool | None]
    """
    Whether acting from that step on, within what was left of the fuel, would have avoided it; none if it was never
    visible.
    """
    band: int
    """Its speed band in a failure profile, from 0."""
    bearing_deg: float
    """Where it was some steps before, seen from the agent: degrees in [0, 360) from radial out towards in-track."""
    bearing_inertial_deg: NotRequired[float | None]
    """The same from +X towards +Y of the inertial frame; none in a world without one."""
    body: int
    """The id of what was met, among the bodies of its kind."""
    cheapest: NotRequired[RemedyView | None]
    first_visible_step: NotRequired[int | None]
    """The first step after which the body was visible (0: at the start); none if it never was."""
    relative_speed: float
    """Relative speed at contact, in the world's unit of speed."""
    sector: int
    """Its bearing sector in a failure profile, 0 to 11."""
    steps_left: int
    """Steps from then to the contact in which somebody could still act."""


class EpisodeHead(TypedDict):
    """One episode in a list."""

    at: NotRequired[str | None]
    """When it was reported, RFC 3339."""
    episode: str
    """Its id."""
    layout: NotRequired[str | None]
    """The layout's id, where its group was designed."""
    level: NotRequired[int | None]
    """The level its scenario was drawn at."""
    policy_version: NotRequired[int | None]
    """The policy that flew it."""
    replay: Replayable
    """`available`, `expired` (past what the run keeps whole) or `none` (it has no actions)."""
    role: str
    """What its group was for: the curriculum's role of it (`frontier`, `replay`, `probe`, …), `designed` or `suite`."""
    score: NotRequired[float | None]
    """The score, by replay."""
    skill: NotRequired[float | None]
    """The skill, where the scenario defines one."""
    state: str
    """`leased`, `finished`, `failed`, `late` or `expired`."""
    success: NotRequired[bool | None]
    """Whether it is a success, by the run's rule."""
    task: NotRequired[str | None]
    """The task."""


class Episodes(TypedDict):
    """A page of reported episodes."""

    episodes: list[EpisodeHead]
    """In order of lease and index."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class FailureView(TypedDict):
    """One reason why score was lost."""

    agent: int
    """Whose."""
    encounter: NotRequired[EncounterView | None]
    measures: list[MeasureView]
    """Further numbers that belong to the mode."""
    mode: str
    """The failure mode."""
    step: int
    """When, counted from 1."""
    words: str
    """The same in one sentence."""


class FoundEpisodes(TypedDict):
    """A page of episodes that were looked for."""

    episodes: list[EpisodeHead]
    """In the order asked for."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""


class History(TypedDict):
    """How levels moved."""

    moves: list[MoveView]
    """In order."""
    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""
    points: list[Point]
    """
    Success on contested scenarios over time: each task's evidence in at most 100 parts of equal size. Only on the
    first page.
    """


class Judged(StoredFlown):
    """How actions fared."""

    skill: NotRequired[float | None]
    """Against floor and reference."""
    success: bool
    """By the task's own rule."""


class Layout(DesignHead):
    """A layout with its bodies."""

    bracket: BracketView
    """What the scenario is worth."""
    design: NotRequired[dict[str, Any] | None]
    """The design in the language of its world: aim, params, encounters."""
    scenario: dict[str, Any]
    """The scenario, complete with its bodies: `POST /v1/scenarios` takes it as it is."""
    scenario_id: str
    """The scenario's id."""
    witness: StoredFlown
    """How the witness fared: the planner's own flight, which shows that it can be done."""


class Lease(TypedDict):
    """A lease: recipes once each, and groups that name a recipe and a seed."""

    expires_at: str
    """Until when it holds, RFC 3339."""
    form: str
    """`groups` or `columns`."""
    group_size: int
    """Episodes in each group."""
    groups: list[Group]
    """The groups; of a lease of columns, those that are audited."""
    lease: str
    """Its id."""
    policy_version: int
    """The policy it was taken for."""
    purpose: str
    """What it is for."""
    ranges: NotRequired[list[Range] | None]
    """Of a lease of columns, all its groups by ranges of seeds."""
    recipes: list[dict[str, Any]]
    """Scenarios without their seeds: world, task, params, physics, layout."""
    run: str
    """Its run."""
    status: str
    """`active`, `done`, `released` or `expired`."""


class LeaseWish(TypedDict):
    """A lease as it is asked for."""

    evaluation: NotRequired[str | None]
    """
    With `purpose: eval`: the evaluation whose scenarios are wanted, of those that nobody flies. As many groups are answered as there
    are, at most as many as were asked for.
    """
    form: NotRequired[Form]
    """
    `groups` (default): every group with its scenario and bracket, every log replayed. `columns`: for 10⁵ episodes and more a
    second: ranges of seeds, as they come, without brackets; results are columns, of which some groups are audited.
    """
    group_size: NotRequired[int | None]
    """Episodes of one scenario in each (the run's group_size)."""
    groups: int
    """How many groups: 1 to 1 024; with `form: columns` 1 to 100 000."""
    policy_version: NotRequired[int]
    """The policy that will fly it (0)."""
    purpose: NotRequired[Purpose]
    """`train` (default), `probe` or `eval`."""
    refill: NotRequired[bool]
    """
    Whether groups whose episodes all have the same score are replaced, up to as many as were asked for (false). The answer to
    their results names the groups that came in their place.
    """
    ttl_s: NotRequired[int]
    """How long it holds, seconds: 1 to 86 400 (600)."""


class Masteries(TypedDict):
    """What an agent has mastered."""

    explanation: dict[str, Any]
    """The strategy's rules, and what moved on what evidence, in words."""
    tasks: list[TaskMastery]
    """One per task of the run."""


class ModeView(TypedDict):
    """A failure mode."""

    about: str
    """What it is, in one sentence."""
    cells: list[CellView]
    """Where it occurred, by sector and band; cells in which it never did are left out."""
    count: int
    """How often it occurred."""
    inertial: list[InertialView]
    """
    The same failures by where the body was in the inertial frame: sector 0 is centred on +X, 3 on +Y. Sectors without
    failures are left out; empty in a world without such a frame.
    """
    mode: str
    """Its name."""
    per_episode: NotRequired[Trend | None]
    share: NotRequired[Trend | None]
    weight: float
    """What that weighs now."""


class Overview(TypedDict):
    """A run in a glance."""

    episodes: int
    """Episodes that finished, those of columns included."""
    episodes_per_s: float
    """Episodes a second over the last five minutes."""
    last: NotRequired[Last | None]
    leases: int
    """Active leases."""
    prepared: int
    """Scenarios that wait to be leased."""
    proposed: int
    """Proposals whose scenarios are being made."""
    run: str
    """The run."""
    skill: list[float | None]
    """Mean skill over the run's life in at most 60 parts, all tasks together; null where nothing came back."""
    tasks: list[TaskGlance]
    """Its tasks, and where they stand."""


class PolicyView(PolicySettings):
    """The policy of a run, and how it goes."""

    changed_at: NotRequired[str | None]
    """When it was set, RFC 3339."""
    episodes: int
    """Episodes in them."""
    failed: int
    """Episodes that the infrastructure lost: the model's endpoint, as a rule."""
    feed: FeedView
    """How full the feed is."""
    groups: int
    """Groups pushed to the feed so far."""
    model: NotRequired[str | None]
    """The model that `chat` asks; where it is, only the server knows."""
    policy: str
    """`off`, `chat`, or a built-in policy by name."""
    tokens_in: int
    """Tokens that the model read and wrote."""
    tokens_out: int
    """Tokens that it wrote."""
    trouble: NotRequired[TroubleView | None]
    version: int
    """Its version, which groups begun now carry."""


class Profile(TypedDict):
    """Why a task's episodes lose score. A failure's weight is 1 when it is entered and halves every half-life."""

    bands: list[BandView]
    """The bands of relative speed."""
    criticised: int
    """Episodes criticised: what everything below is counted over."""
    failed: int
    """Episodes that could not be criticised; the server's log says why."""
    judge: NotRequired[Trend | None]
    modes: list[ModeView]
    """The failure modes of the task, those that never occurred included."""
    sectors: list[SectorView]
    """The 12 bearing sectors: where the body was, seen from the agent, in degrees from radial out towards in-track."""
    skipped: int
    """Episodes that were sampled out, while too many waited."""
    task: str
    """The task."""
    verdicts: list[VerdictView]
    """Actions per episode by verdict."""
    waiting: int
    """Episodes that wait. criticised + skipped + failed + waiting are the finished episodes of training and probes."""
    weight: float
    """What these episodes weigh together."""


class Profiles(Backlog):
    """Why a run's episodes lose score."""

    half_life: float
    """Criticised episodes of a task after which a failure weighs half."""
    run: str
    """The run."""
    tasks: list[Profile]
    """One per task of the run."""


class Receipts(TypedDict):
    """What became of a batch."""

    groups: list[GroupEnd]
    """Groups that these results closed."""
    moves: list[dict[str, Any]]
    """Level moves that these results caused."""
    refills: list[Refill]
    """Groups that leases were given in place of those whose episodes all have the same score (`refill`)."""
    results: list[Receipt]
    """One per result, in order."""


class ResultItem(TypedDict):
    """One episode's result. There is no score in it: that comes from the actions."""

    actions: NotRequired[Actions | None]
    episode: str
    """The episode's id."""
    metrics: NotRequired[Metrics | None]
    policy_version: NotRequired[int | None]
    """The policy that flew it."""
    reason: NotRequired[str | None]
    """Why it failed, in a few words."""
    status: NotRequired[Status]
    """Whether it was flown, or the infrastructure lost it (finished)."""


class Results(TypedDict):
    """A batch of results."""

    policy_version: NotRequired[int | None]
    """The policy that flew them, where an episode does not say (the lease's)."""
    results: list[ResultItem]
    """At most 5 000, and 16 MiB together: episodes of many steps come fewer at a time."""


class RunChange(TypedDict):
    """
    What is to change of a run; what is left out stays as it is. Tasks keep their level and mastery unless their table or physics
    change; under another strategy they keep their mastery, and the strategy starts afresh.
    """

    audit_groups: NotRequired[int | None]
    """Groups of a lease of columns whose logs are replayed."""
    contested_share: NotRequired[float | None]
    """Share of proposals whose scenario must be contested."""
    evidence_from: NotRequired[EvidenceFrom | None]
    frontier_share: NotRequired[float | None]
    """Share of proposals at the current level."""
    group_size: NotRequired[int | None]
    """Episodes of one scenario in a group."""
    max_staleness: NotRequired[int | None]
    """Results older than this many policy versions move nothing."""
    min_group: NotRequired[int | None]
    """Finished episodes from which a partial group counts."""
    name: NotRequired[str | None]
    """Its name for people."""
    placement: NotRequired[bool | None]
    """Whether tasks that are new are placed."""
    strategy: NotRequired[str | None]
    """How proposals are chosen."""
    strategy_settings: NotRequired[dict[str, float | str]]
    """The strategy's own settings, by name; those left out are at their defaults (in a change of a run that keeps its strategy: stay). `GET /v1/strategies` lists them."""
    target: NotRequired[str | None]
    """What the ladder climbs by."""
    task_settings: NotRequired[dict[str, TaskWish]]
    """What is special about single tasks, by id."""
    tasks: NotRequired[list[str] | None]
    """The tasks, all of them: those that are not in it go."""


class RunWish(TypedDict):
    """A run as it is asked for. Everything may be left out."""

    audit_groups: NotRequired[int | None]
    """Groups of a lease of columns whose logs are replayed (64): 1 to 1 024."""
    contested_share: NotRequired[float | None]
    """Share of proposals whose scenario must be contested (0.5)."""
    design: NotRequired[DesignWish]
    """Layouts designed for the agent's failures, mixed into its training."""
    evidence_from: NotRequired[EvidenceFrom | None]
    frontier_share: NotRequired[float | None]
    """Share of proposals at the current level (0.7)."""
    group_size: NotRequired[int | None]
    """Episodes of one scenario in a group (1)."""
    id: NotRequired[str | None]
    """An id of your choice: 1 to 64 of a-z, 0-9, - and _. Else one is made up."""
    judge: NotRequired[str | None]
    """Who judges the steps of sessions that fly for this run: `off`, `deterministic` or `llm` (what the server is set to)."""
    max_staleness: NotRequired[int | None]
    """Results older than this many policy versions move nothing (no limit)."""
    min_group: NotRequired[int | None]
    """Finished episodes from which a partial group counts (half of group_size)."""
    name: NotRequired[str | None]
    """A name for people."""
    placement: NotRequired[bool | None]
    """Whether a new run is placed by bisection over the levels (true)."""
    retention: NotRequired[RetentionWish]
    """What is kept whole."""
    seed: NotRequired[int | None]
    """The seed of the run's random streams, from 0 to 2^51 − 1. Else one is drawn."""
    strategy: NotRequired[str | None]
    """How proposals are chosen (ladder)."""
    strategy_settings: NotRequired[dict[str, float | str]]
    """The strategy's own settings, by name; those left out are at their defaults (in a change of a run that keeps its strategy: stay). `GET /v1/strategies` lists them."""
    success: NotRequired[SuccessSetting | None]
    target: NotRequired[str | None]
    """What the ladder climbs by: `mastery`, or `half` (the default when group_size > 1)."""
    task_settings: NotRequired[dict[str, TaskWish]]
    """What is special about single tasks, by id."""
    tasks: NotRequired[list[str] | None]
    """
    The tasks (those of the first world, kessler). Tasks of several worlds may be mixed where the agent can act in
    all of them.
    """


Series = TypedDict(
    "Series",
    {
        "from": str,
        "tasks": list[TaskSeries],
        "to": str,
        "width_s": int,
    },
)


class Strategies(TypedDict):
    """All strategies."""

    strategies: list[Strategy]
    """The default first."""


class Summary(TypedDict):
    """What was designed for a run."""

    designed_groups: int
    """Of these, designed."""
    designers: list[DesignerSummary]
    """By the designer that was asked."""
    llm: NotRequired[dict[str, Any] | None]
    """How the language model is; none where none is configured."""
    run: str
    """The run."""
    settings: dict[str, Any]
    """What the run wants of designs."""
    share: NotRequired[float | None]
    """designed_groups / train_groups; none before the first."""
    tasks: list[TaskSummary]
    """By task."""
    train_groups: int
    """Groups leased for training so far."""


class TrajectoryEpisode(TypedDict):
    """An episode of a group."""

    id: str
    """Its id."""
    last_observation: NotRequired[dict[str, Any] | None]
    """What the agents were told at the end."""
    metrics: NotRequired[ModelMetrics | None]
    score: float
    """The score, by replay."""
    skill: NotRequired[float | None]
    """The skill, where the scenario defines one."""
    steps: list[TrajectoryStep]
    """Step by step."""
    stopped: NotRequired[str | None]
    """Why the agent went no further: `unparsable`, `too_long` or `too_late`."""
    success: bool
    """Whether it is a success, by the run's rule."""


class TrajectoryGroup(TypedDict):
    """A finished group, but for its id and how often it was delivered."""

    bracket: BracketView
    """What the scenario is worth. For the trainer, never for the agent."""
    contested: bool
    """Whether acting well matters on this scenario."""
    episodes: list[TrajectoryEpisode]
    """The others."""
    failed: int
    """Episodes that the infrastructure lost: they are not here, and count as nothing."""
    group: int
    """Its number in the lease."""
    layout: NotRequired[str | None]
    """The layout's id, where it was designed."""
    lease: str
    """The lease under which it was flown."""
    level: NotRequired[int | None]
    """The level."""
    messages: str
    """`none`: a built-in policy has no conversations; `kept`; or `dropped` like observations."""
    observations: str
    """`telemetry`, `none` (as asked), or `dropped`: with them the group would be larger than 16 MiB."""
    policy: str
    """The policy that flew it."""
    policy_version: int
    """Its version."""
    recipe: dict[str, Any]
    """The scenario without its seed: world, task, params, physics, layout."""
    role: str
    """`placement`, `frontier`, `rehearsal`, `sample` or `designed`."""
    run: str
    """The run."""
    scenario: str
    """The scenario's id."""
    seed: int
    """The seed that makes the recipe a scenario."""
    task: str
    """The task."""


class Version(TypedDict):
    """A version of a run's policy."""

    checkpoint: NotRequired[str | None]
    """Where its weights are, as it was told."""
    notes: NotRequired[str | None]
    """Whatever else was told."""
    staleness: int
    """Versions between it and the newest."""
    tasks: list[VersionTask]
    """How it fared, task by task: over all episodes but evaluations, contested or not."""
    told_at: NotRequired[str | None]
    """When it was told of, RFC 3339; none of what only came with results."""
    version: int
    """The version."""


class Versions(TypedDict):
    """A page of versions."""

    next: NotRequired[str | None]
    """Cursor of the next page, if there may be one."""
    versions: list[Version]
    """The newest first."""


class Wish(TypedDict):
    """A scenario to look at, and actions to fly on it."""

    actions: NotRequired[Actions | None]
    scenario: dict[str, Any]
    """
    The scenario: a task and a seed from 0 to 2^51 − 1, and what is wanted of params, physics and layout, whose defaults
    hold for what is left out. A layout is `{mode, bodies, provenance}`: tables of rows that stand after what is drawn
    (`extend`) or instead of it (`replace`), at most 512 rows in all.
    """
    telemetry: NotRequired[bool]
    """
    Whether to answer with `frames`: the flight step by step, with what the agents saw (false). Without actions
    nobody acts.
    """


class CritiqueView(TypedDict):
    """What a finished episode shows, from its scenario and actions alone."""

    actions: list[ActionView]
    """What each action was worth, in order of step: the counterfactual is the same episode without it."""
    failures: list[FailureView]
    """Why score was lost, in order of step."""
    judged: JudgedView
    """The deterministic judge."""


class Delivered(TrajectoryGroup):
    """A group, and what became of it."""

    deliveries: int
    """How often it was delivered, this time included. More than once: it may have been taken before."""
    id: int
    """Its id, by which it is acknowledged and told from others: never used twice."""


class Design(DesignHead):
    """One design."""

    bracket: NotRequired[BracketView | None]
    design: NotRequired[dict[str, Any] | None]
    """
    The design in the language of its world: aim, params, encounters. As the gate read it, or, where it was refused, as
    it was given; none where it was too long to be kept.
    """
    episodes: list[str]
    """The newest finished episodes behind it, the newest first: at most 16."""
    scenario_id: NotRequired[str | None]
    """The scenario's id; none where it was refused. `GET /v1/layouts/{layout}` shows the bodies."""
    turns: list[TurnView]
    """Every change of its state, in order."""


class Episode(EpisodeHead):
    """One episode with its scenario."""

    actions: NotRequired[dict[str, Any] | None]
    """The actions, one entry a step: a list of `[agent, value, …]`."""
    bracket: NotRequired[BracketView | None]
    contested: bool
    """Whether the scenario is contested."""
    floor: NotRequired[float | None]
    """The floor it was judged by."""
    flown: NotRequired[StoredFlown | None]
    metrics: NotRequired[dict[str, Any] | None]
    """What the trainer logged."""
    reason: NotRequired[str | None]
    """Why it failed."""
    reference: NotRequired[float | None]
    """The reference score it was judged by."""
    scenario: NotRequired[dict[str, Any] | None]
    """The scenario, complete; likewise."""
    scenario_id: NotRequired[str | None]
    """The scenario's id; none past what the run keeps whole."""


class EpisodeCritique(CritiqueView):
    """The critique of one episode."""

    episode: str
    """The episode."""
    task: str
    """The task."""


class Pulled(TypedDict):
    """Groups of a feed."""

    groups: list[Delivered]
    """In order of their ids."""
    next: NotRequired[int | None]
    """The last id: what came later is read by `after`."""


class Checked(TypedDict):
    """What a scenario is."""

    bracket: NotRequired[BracketView | None]
    contested: bool
    """The reference succeeds and acting blindly mostly does not."""
    critique: NotRequired[CritiqueView | None]
    fair: bool
    """Nothing is lost before anybody could act."""
    flown: NotRequired[Judged | None]
    frames: NotRequired[list[dict[str, Any]] | None]
    """
    Where `telemetry` was asked for and the scenario is fair: the start, then one frame a step, as a run's episode is
    replayed, with `observation`: what the agents saw.
    """
    scenario: dict[str, Any]
    """The scenario, complete."""
    scenario_id: str
    """Its id."""
    solvable: bool
    """The reference succeeds."""
    unfair_because: NotRequired[str | None]
    """Why it is not fair."""
