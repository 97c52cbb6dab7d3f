/** What a model or a trainer wrote stays text: markup, quotes, right-to-left, and ten thousand characters of it. */
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { go, launch, open } from "./browser";
import { hold, Sparring } from "./sparring";

const MARKUP = `<img src=x onerror="alert(1)"><script>alert(2)</script>'"\`{{7*7}}`;
const TURNED = "\u202Eruomra\u202C שלום مرحبا";
const LONG = `${MARKUP} ${"x".repeat(10_000)}`;

let browser: Browser;
let service: Sparring;
let model: Server;
let failed: string;

/** A model that names its designs as an attacker would. */
function attacker(): Promise<Server> {
  let nth = 0;
  const server = createServer((request, response) => {
    request.resume();
    nth += 1;
    const design = {
      aim: { mode: "collision", bearing_deg: (nth * 40) % 360 },
      frame: "radial_in_track",
      name: `${String(nth)} ${MARKUP}${TURNED}`,
      encounters: [
        {
          kind: "threat",
          satellite: 0,
          step: 10 + nth,
          bearing_deg: (nth * 40) % 360,
          relative_speed: 40,
          miss_distance: 19,
        },
      ],
    };
    const content = nth % 2 === 0 ? LONG : JSON.stringify({ layouts: [design] });
    response.setHeader("content-type", "application/json");
    response.end(
      JSON.stringify({
        choices: [{ message: { role: "assistant", content }, finish_reason: "stop" }],
        usage: { prompt_tokens: 1, completion_tokens: 1 },
      }),
    );
  });
  return new Promise((done) => server.listen(0, "127.0.0.1", () => done(server)));
}

beforeAll(async () => {
  [browser, model] = [await launch(), await attacker()];
  const { port } = model.address() as AddressInfo;
  service = await Sparring.start([
    "--llm-url",
    `http://127.0.0.1:${String(port)}/v1`,
    "--llm-model",
    MARKUP,
    "--llm-retries",
    "0",
  ]);
  await service.post("/v1/runs", {
    id: "run",
    name: `${MARKUP}${TURNED}`,
    seed: 3,
    tasks: ["kessler/survival"],
  });
  await service.put("/v1/runs/run/versions/0", {
    checkpoint: MARKUP,
    notes: `${MARKUP}${TURNED} ${"n".repeat(1800)}`,
  });
  for (let i = 0; i < 3; i++) await hold(service, "run", 64, { metrics: { said: LONG } });
  const lease = await service.post<{ groups: { episodes: string[] }[] }>("/v1/runs/run/leases", {
    groups: 1,
  });
  failed = lease.groups[0]?.episodes[0] ?? "";
  await service.post("/v1/runs/run/results", {
    results: [{ episode: failed, status: "failed", reason: `${MARKUP}${TURNED}` }],
  });
  await service.post("/v1/evaluations", {
    policy: "hold",
    suite: "docking-heldout-v1",
    name: `${MARKUP}${TURNED}`,
  });
  for (let i = 0; i < 4; i++) {
    const ask = await service.post<{ id: string }>("/v1/runs/run/designs", { designer: "llm", n: 1 });
    for (let wait = 0; wait < 100; wait++) {
      const { state } = await service.get<{ state: string }>(`/v1/runs/run/designs/asks/${ask.id}`);
      if (state !== "waiting" && state !== "asked" && state !== "running" && state !== "open") break;
      await new Promise((wake) => setTimeout(wake, 100));
    }
  }
});
afterAll(async () => {
  await browser.close();
  await service.end();
  model.close();
});

test("nothing of it becomes markup, and nothing of it runs", async () => {
  const designs = await service.get<{ designs: { id: string; name: string }[] }>("/v1/runs/run/designs");
  expect(
    designs.designs.some((design) => design.name.includes("<img") || design.name.includes("onerror")),
  ).toBe(true);
  const first = designs.designs[0]?.id ?? "";
  for (const dark of [false, true]) {
    const { page, wrong } = await open(browser, service.url, { dark, width: 390 });
    for (const place of [
      "/",
      "/runs/run",
      "/runs/run/designs",
      `/runs/run/designs/${first}`,
      "/runs/run/episodes",
      `/runs/run/episodes/${failed}`,
      "/evaluations",
      "/evaluations/eval-1",
    ]) {
      await go(page, service.url, place);
      await page.waitForTimeout(300);
      const found = await page.evaluate(() => ({
        images: document.querySelectorAll('img[src="x"]').length,
        scripts: document.querySelectorAll("main script").length,
        over: document.documentElement.scrollWidth - document.documentElement.clientWidth,
      }));
      expect(found, place).toEqual({ images: 0, scripts: 0, over: 0 });
    }
    expect(wrong.filter((one) => !(one.includes("404") && /(replay|critique)/.test(one)))).toEqual([]); // an episode that was never flown has no replay
    await page.context().close();
  }
});

test("what turns the order of text around is shown, and turns nothing", async () => {
  const { page } = await open(browser, service.url);
  for (const place of [
    "/",
    "/runs/run",
    "/runs/run/failures",
    `/runs/run/episodes/${failed}`,
    "/evaluations",
  ]) {
    await go(page, service.url, place);
    await page.locator("main").getByText("⟨U+202E⟩").first().waitFor();
    const seen = await page.evaluate(() => document.title + (document.body.textContent ?? ""));
    expect(seen, place).not.toMatch(/[\u202a-\u202e\u2066-\u2069]/);
  }
  await page.context().close();
});

test("it is there to be read", async () => {
  const { page } = await open(browser, service.url);
  await go(page, service.url, "/");
  await page.getByText(MARKUP).first().waitFor();
  await go(page, service.url, "/runs/run/designs");
  await page.getByText("<img").first().waitFor();
  await go(page, service.url, "/evaluations");
  await page.getByText(MARKUP).first().waitFor();
  await page.context().close();
});
