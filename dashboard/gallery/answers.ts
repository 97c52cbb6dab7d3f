/**
 * Answers of the gallery's server. The id of a run, or the search of a list, chooses the state: `slow` never answers, `failing` fails,
 * `empty` has nothing, `few` a part, all others have everything.
 */
import {
  estimate,
  evaluation,
  evaluationSummary,
  policyVersions,
  runOverview,
  runSummary,
  SETTINGS_HISTORY,
  trainerList,
} from "./fixtures/run";
import { ago, list } from "./fixtures/numbers";
import { CRITIQUE, EPISODE, kesslerFrames } from "./fixtures/replay";
import { TASK, taskSeries } from "./fixtures/task";

/** Number of runs of a table, and of one whose search is `few`: as many as a window has. */
const [MANY_RUNS, FEW_RUNS] = [1000, 12];

/** Versions of the policy that the evaluated runs have. */
const EVALUATED = [1, 2, 3, 4, 5, 6];

/** Returns the answer to a path, as the API has it; undefined for a path without fixture. */
function bodyOf(path: string, query: URLSearchParams): unknown {
  const [, version, collection, id, ...parts] = path.split("/");
  if (version !== "v1") return undefined;
  const isEmpty = id === "empty" || query.get("search") === "empty";
  switch (collection) {
    case "runs":
      return id ? runPart(id, parts, isEmpty) : runPage(query, isEmpty);
    case "run_groups":
      return {
        groups: isEmpty
          ? []
          : [
              { value: "ladder", runs: 600, episodes: 120_000, last_results_at: ago(2) },
              { value: "uniform", runs: 400, episodes: 80_000, last_results_at: ago(600) },
            ],
        missing_shards: [],
      };
    case "evaluations":
      return evaluationPart(id, query);
    case "strategies":
      return { strategies: [] };
    default:
      return undefined;
  }
}

function runPage(query: URLSearchParams, isEmpty: boolean) {
  const [first, limit] = [Number(query.get("cursor") ?? 0), Number(query.get("limit") ?? 100)];
  const total = isEmpty ? 0 : query.get("search") === "few" ? FEW_RUNS : MANY_RUNS;
  const runs = list(Math.max(0, Math.min(limit, total - first)), (i) => runSummary(first + i));
  const next = first + limit < total ? String(first + limit) : null;
  return { runs, total, next, missing_shards: [] };
}

function runPart(id: string, [part, ...rest]: string[], isEmpty: boolean): unknown {
  switch (part) {
    case undefined:
      return id === "unknown" ? undefined : runSummary(0, { id });
    case "overview":
      return runOverview(id, isEmpty ? 0 : undefined);
    case "trainers":
      return trainerList(isEmpty ? 0 : id === "huge" ? 40 : 3);
    case "policy_versions":
      return { versions: isEmpty ? [] : policyVersions(10), next: id === "huge" ? "more" : null };
    case "settings":
      return { settings: isEmpty ? SETTINGS_HISTORY.slice(0, 1) : SETTINGS_HISTORY, next: null };
    case "episodes":
      return episodePart(rest);
    case "series":
      return {
        from: ago(1800),
        to: ago(0),
        resolution: "episodes",
        tasks: isEmpty ? [] : [taskSeries(40), taskSeries(40, "docking/single", 9)],
      };
    default:
      return undefined;
  }
}

function episodePart([, part]: string[]): unknown {
  if (part === "replay") return { episode: EPISODE.episode, frames: kesslerFrames(), scenario: {} };
  return part === "critique" ? CRITIQUE : EPISODE;
}

function evaluationPart(id: string | undefined, query: URLSearchParams): unknown {
  if (id === undefined || id === "") {
    const evaluations = ["run-0000", "run-0001"].flatMap((run, at) =>
      EVALUATED.map((version) => evaluationSummary(10 * at + version, { run, policy_version: version })),
    );
    return { evaluations, next: null, missing_shards: [] };
  }
  if (id === "compare") {
    const across = { trainings: 1 };
    const side = (name: string) => ({ evaluations: (query.get(name) ?? "").split(","), across });
    const rows = [
      {
        task: TASK,
        part: "all",
        scenarios: 200,
        success: estimate(0.12),
        skill: estimate(0.08, 0.1),
        improvement: estimate(0.64),
      },
    ];
    return { suite: "kessler-heldout-v1", a: side("a"), b: side("b"), rows };
  }
  const version = Number(id.replace("eval-", "")) % 10;
  return evaluation(version, "run-0000");
}

/** Answers a request in place of `fetch`. */
export async function answer(input: RequestInfo | URL, init?: RequestInit): Promise<Response> {
  const request = new Request(input, init);
  const { pathname, searchParams } = new URL(request.url);
  const state = pathname.split("/")[3] ?? "";
  const search = searchParams.get("search") ?? "";
  const json = (status: number, body: unknown) =>
    new Response(JSON.stringify(body), { status, headers: { "content-type": "application/json" } });
  if (state === "slow" || search === "slow" || pathname.endsWith("/events"))
    return new Promise(() => undefined);
  if (state === "failing" || search === "failing")
    return json(503, { detail: "The database is locked by another process; the server tries again." });
  const body = bodyOf(pathname, searchParams);
  return body === undefined
    ? json(404, { detail: `The gallery has no fixture for ${pathname}.` })
    : json(200, body);
}
