import { expect, test } from "vitest";
import { activityOf, activityOfRun } from "./activity";

const at = (seconds: number) => new Date(1000 * seconds).toISOString();

test("a run with recent results is running, with its current rate", () => {
  const overview = { episodes: 500, episodes_per_s: 3, first_results_at: at(100), last_results_at: at(1000) };
  expect(activityOf(overview, 1_030_000)).toEqual({
    state: "running",
    text: "for 15 min 30 s, latest results 30 s ago",
    rate: 3,
    rateOf: "last 5 min",
  });
  expect(activityOf(overview, 1_005_000).text).toBe("for 15 min 5 s");
});

test("the duration and the rate of an idle run do not change any more", () => {
  const overview = {
    episodes: 1800,
    episodes_per_s: 0,
    first_results_at: at(100),
    last_results_at: at(1000),
  };
  expect(activityOf(overview, 8_200_000)).toEqual({
    state: "idle",
    text: "for 2 h, after 15 min with results",
    rate: 2,
    rateOf: "whole run",
  });
});

test("a paused run is paused at once, with the rate of the whole run", () => {
  const overview = {
    episodes: 1800,
    episodes_per_s: 3,
    first_results_at: at(100),
    last_results_at: at(1000),
  };
  expect(activityOf(overview, 1_001_000, "paused")).toEqual({
    state: "paused",
    text: "after 15 min with results",
    rate: 2,
    rateOf: "whole run",
  });
});

test("a run without results waits", () => {
  const overview = { episodes: 0, episodes_per_s: 0, first_results_at: null, last_results_at: null };
  expect(activityOf(overview, 0).state).toBe("waiting");
  expect(activityOf(overview, 0, "paused").text).toBe("without results");
});

test("a run of a list is archived, paused, or what its results say", () => {
  const run = {
    status: "active" as const,
    archived_at: null,
    episodes: 5,
    first_results_at: at(100),
    last_results_at: at(1000),
  };
  const state = (changes: object, now = 1_030_000) => activityOfRun({ ...run, ...changes }, now).state;
  expect(state({})).toBe("running");
  expect(state({}, 1_061_000)).toBe("idle");
  expect(state({ first_results_at: null, last_results_at: null })).toBe("waiting");
  expect(state({ status: "paused" })).toBe("paused");
  expect(state({ status: "paused", archived_at: at(1001) })).toBe("archived");
  expect(activityOfRun(run, 1_002_000).text).toBe("running for 15 min 2 s");
  expect(activityOfRun({ ...run, status: "paused" }, 1_002_000).text).toBe(
    "paused after 15 min with results: the run grants no leases",
  );
});
