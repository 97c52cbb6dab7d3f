/** Checks that texts of language models and trainers stay text: markup, quotes, right-to-left text, 10 000 characters. */
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { launchBrowser, openPage, visit, waitUntilIdle } from "./browser";
import { waitFor } from "./poll";
import { reportHeldEpisodes, SparringServer } from "./server";

const MARKUP = `<img src=x onerror="alert(1)"><script>alert(2)</script>'"\`{{7*7}}`;
const BIDI = "\u202Eruomra\u202C שלום مرحبا";
const LONG = `${MARKUP} ${"x".repeat(10_000)}`;

let browser: Browser;
let server: SparringServer;
let llm: Server;
/** Id of an episode that its trainer reported as failed. */
let failedEpisode: string;

/** Starts an endpoint of a language model that puts markup into the names of its designs. */
function startHostileLlm(): Promise<Server> {
  let requests = 0;
  const server = createServer((request, response) => {
    request.resume();
    requests += 1;
    const design = {
      aim: { mode: "collision", bearing_deg: (requests * 40) % 360 },
      frame: "radial_in_track",
      name: `${String(requests)} ${MARKUP}${BIDI}`,
      encounters: [
        {
          kind: "threat",
          satellite: 0,
          step: 10 + requests,
          bearing_deg: (requests * 40) % 360,
          relative_speed: 40,
          miss_distance: 19,
        },
      ],
    };
    const content = requests % 2 === 0 ? LONG : JSON.stringify({ layouts: [design] });
    response.setHeader("content-type", "application/json");
    response.end(
      JSON.stringify({
        choices: [{ message: { role: "assistant", content }, finish_reason: "stop" }],
        usage: { prompt_tokens: 1, completion_tokens: 1 },
      }),
    );
  });
  return new Promise((resolve) => server.listen(0, "127.0.0.1", () => resolve(server)));
}

beforeAll(async () => {
  [browser, llm] = [await launchBrowser(), await startHostileLlm()];
  const { port } = llm.address() as AddressInfo;
  server = await SparringServer.start([
    "--llm-url",
    `http://127.0.0.1:${String(port)}/v1`,
    "--llm-model",
    MARKUP,
    "--llm-retries",
    "0",
  ]);
  await server.post("/v1/runs", {
    id: "run",
    name: `${MARKUP}${BIDI}`,
    seed: 3,
    tasks: ["kessler/survival"],
  });
  await server.put("/v1/runs/run/policy_versions/0", {
    checkpoint: MARKUP,
    notes: `${MARKUP}${BIDI} ${"n".repeat(1800)}`,
  });
  for (let i = 0; i < 3; i++) await reportHeldEpisodes(server, "run", 64, { metrics: { note: LONG } });
  const lease = await server.post<{ groups: { episodes: string[] }[] }>("/v1/runs/run/leases", {
    groups: 1,
  });
  failedEpisode = lease.groups[0]?.episodes[0] ?? "";
  await server.post("/v1/runs/run/results", {
    results: [{ episode: failedEpisode, status: "failed", reason: `${MARKUP}${BIDI}` }],
  });
  await server.post("/v1/evaluations", {
    policy: "hold",
    suite: "docking-heldout-v1",
    name: `${MARKUP}${BIDI}`,
  });
  for (let i = 0; i < 4; i++) {
    const { id } = await server.post<{ id: string }>("/v1/runs/run/designs", { designer: "llm", count: 1 });
    await waitFor(
      () => server.get<{ state: string }>(`/v1/runs/run/designs/requests/${id}`),
      ({ state }) => state === "done" || state === "failed",
    );
  }
});
afterAll(async () => {
  await browser.close();
  await server.dispose();
  llm.close();
});

test("markup is neither rendered nor executed", async () => {
  const { designs } = await server.get<{ designs: { id: string; name: string }[] }>("/v1/runs/run/designs");
  expect(designs.some(({ name }) => name.includes("<img") || name.includes("onerror"))).toBe(true);
  const routes = [
    "/",
    "/runs/run",
    "/runs/run?tab=failures",
    "/runs/run?tab=trainer",
    "/runs/run?tab=activity",
    "/runs/run?tab=settings",
    "/runs/run/designs",
    `/runs/run/designs/${designs[0]?.id ?? ""}`,
    "/runs/run/episodes",
    `/runs/run/episodes/${failedEpisode}`,
    "/evaluations",
    "/evaluations/eval-1",
  ];
  for (const dark of [false, true]) {
    const observed = await openPage(browser, server.url, { dark, width: 390 });
    const { page, problems } = observed;
    for (const route of routes) {
      await visit(page, server.url, route);
      await waitUntilIdle(observed);
      const counts = await page.evaluate(() => ({
        images: document.querySelectorAll('img[src="x"]').length,
        scripts: document.querySelectorAll("main script").length,
        overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
      }));
      expect(counts, route).toEqual({ images: 0, scripts: 0, overflow: 0 });
    }
    // A failed episode has no replay and no critique.
    const isExpected = (problem: string) => problem.includes("404") && /(replay|critique)/.test(problem);
    expect(problems.filter((problem) => !isExpected(problem))).toEqual([]);
    await page.context().close();
  }
});

test("bidirectional control characters are shown as escapes", async () => {
  const { page } = await openPage(browser, server.url);
  for (const route of [
    "/",
    "/runs/run?tab=trainer",
    "/runs/run?tab=activity",
    "/runs/run/failures",
    `/runs/run/episodes/${failedEpisode}`,
    "/evaluations",
  ]) {
    await visit(page, server.url, route);
    await page.locator("main").getByText("⟨U+202E⟩").first().waitFor();
    const text = await page.evaluate(() => document.title + (document.body.textContent ?? ""));
    expect(text, route).not.toMatch(/[\u202a-\u202e\u2066-\u2069]/);
  }
  await page.context().close();
});

test("markup is shown as text", async () => {
  const { page } = await openPage(browser, server.url);
  await visit(page, server.url, "/");
  await page.getByText(MARKUP).first().waitFor();
  await visit(page, server.url, "/runs/run/designs");
  await page.getByText("<img").first().waitFor();
  await visit(page, server.url, "/evaluations");
  await page.getByText(MARKUP).first().waitFor();
  await page.context().close();
});
