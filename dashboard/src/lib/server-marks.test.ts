import { expect, test } from "vitest";
import {
  alertsMark,
  commitMark,
  critiquesMark,
  diskMark,
  failedCommitsMark,
  queueMark,
  readyMark,
  sessionsMark,
} from "./server-marks";

test("figures are marked by the limits of the server", () => {
  expect([0, 511, 512, 1024].map((waiting) => queueMark(waiting, 1024).state)).toEqual([
    "good",
    "good",
    "warn",
    "bad",
  ]);
  expect([0, 205, 256].map((sessions) => sessionsMark(sessions, 256).state)).toEqual(["good", "warn", "bad"]);
  expect([0, 2000, 2001].map((waiting) => critiquesMark(waiting).state)).toEqual(["good", "good", "warn"]);
  expect([0, 1].map((alerts) => alertsMark(alerts).state)).toEqual(["good", "warn"]);
  expect([0, 1].map((failed) => failedCommitsMark(failed).state)).toEqual(["good", "bad"]);
  expect([readyMark({ outage: null }).state, readyMark({ outage: "full" }).state]).toEqual(["good", "bad"]);
});

test("commits have no mark before the first one", () => {
  expect([null, 35.7, 100, 2000].map((p99) => commitMark(p99)?.state)).toEqual([
    undefined,
    "good",
    "warn",
    "bad",
  ]);
});

test("the disk has the mark of the alert of its own server, with the limit of the rule", () => {
  const rules = [{ rule: "low_disk" as const, condition: "less than 1024 MiB are free" }];
  const alert = { rule: "low_disk" as const, shard: null, ended_at: null };
  const mark = (alerts: object[], of = rules, shard: string | null = null) =>
    diskMark(5, shard, { rules: of, alerts: alerts as (typeof alert)[] });
  expect(mark([])).toEqual({
    state: "good",
    limit: "Bad if less than 1024 MiB are free: the alert rule low_disk",
  });
  expect(mark([alert])?.state).toBe("bad");
  expect(mark([{ ...alert, ended_at: "2026-01-01T00:00:00Z" }])?.state).toBe("good");
  expect(mark([alert], rules, "east")?.state).toBe("good");
  expect(mark([alert], [])).toBeNull();
  expect(diskMark(null, null, { rules, alerts: [] })).toBeNull();
});
