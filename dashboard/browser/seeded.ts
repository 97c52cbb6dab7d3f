/** One service for all tests that only look: a built-in learner trained there, and two policies were evaluated. */
import type { TestProject } from "vitest/node";
import { Sparring } from "./sparring";

/** Fewer while a test is being written. */
export const EPISODES = Number(process.env["SPARRING_EPISODES"] ?? 100_000);

declare module "vitest" {
  export interface ProvidedContext {
    url: string;
    run: string;
  }
}

let service: Sparring | undefined;

export async function setup(project: TestProject) {
  service = await Sparring.start();
  const told = await service.run("demo", "--url", service.url, "--episodes", String(EPISODES), "--json");
  const { run } = JSON.parse(told) as { run: string };
  for (const policy of ["heuristic", "hold"])
    await service.post("/v1/evaluations", { policy, suite: "docking-heldout-v1" });
  for (const id of ["eval-1", "eval-2"]) {
    for (;;) {
      const { state, trouble } = await service.get<{ state: string; trouble: string | null }>(
        `/v1/evaluations/${id}`,
      );
      if (state === "complete") break;
      if (state === "failed") throw new Error(`${id}: ${trouble ?? ""}`);
      await new Promise((wake) => setTimeout(wake, 200));
    }
  }
  project.provide("url", service.url);
  project.provide("run", run);
}

export async function teardown() {
  await service?.end();
}
