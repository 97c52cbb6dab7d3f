/** Starts the server that all read-only tests share: it has a run of the built-in learner and two evaluations. */
import type { TestProject } from "vitest/node";
import { waitFor } from "./poll";
import { SparringServer } from "./server";

/** Number of episodes that the learner trains on; fewer are enough while a test is being written. */
export const EPISODES = Number(process.env["SPARRING_EPISODES"] ?? 30_000);
const EVALUATION_TIMEOUT_MS = 600_000;

declare module "vitest" {
  export interface ProvidedContext {
    url: string;
    run: string;
  }
}

interface EvaluationState {
  state: string;
  error: string | null;
}

let server: SparringServer | undefined;

export async function setup(project: TestProject) {
  server = await SparringServer.start();
  const output = await server.runCommand(
    "demo",
    "--url",
    server.url,
    "--episodes",
    String(EPISODES),
    "--json",
  );
  const { run } = JSON.parse(output) as { run: string };
  for (const policy of ["heuristic", "hold"]) await evaluate(server, policy);
  project.provide("url", server.url);
  project.provide("run", run);
}

/** Evaluates a built-in policy; one after the other, so that `eval-1` is the first one. */
async function evaluate(server: SparringServer, policy: string) {
  const { id } = await server.post<{ id: string }>("/v1/evaluations", {
    policy,
    suite: "docking-heldout-v1",
  });
  const { state, error } = await waitFor(
    () => server.get<EvaluationState>(`/v1/evaluations/${id}`),
    (evaluation) => evaluation.state === "complete" || evaluation.state === "failed",
    EVALUATION_TIMEOUT_MS,
  );
  if (state === "failed") throw new Error(`${id}: ${error ?? ""}`);
}

export async function teardown() {
  await server?.dispose();
}
