import { expect, test } from "vitest";
import type { EpisodeCritique } from "../lib/api-types";
import { formatGain, verdictReason } from "./verdict-text";

type ActionValue = EpisodeCritique["actions"][number];

function reason(task: string, verdict: ActionValue["verdict"], gain: number, losses = 1): string {
  const failure = { mode: "collision", agent: 1, step: 34, explanation: "", measures: [] };
  const failures = Array.from({ length: losses }, () => failure);
  const action: ActionValue = { step: 2, agent: 1, cost: 0.8, verdict, gain };
  return verdictReason(action, { task, failures, actions: [action] } as unknown as EpisodeCritique);
}

test("a harmful burn with a higher score names the losses", () => {
  expect(reason("kessler/survival", "harmful", 0.042)).toBe(
    "With it, more satellites are lost (satellite 1: collision, step 34).",
  );
  expect(reason("kessler/survival", "harmful", 0.042, 2)).toBe("With it, more satellites are lost.");
  expect(reason("kessler/rendezvous", "harmful", 0.042, 0)).toBe(
    "With it, more satellites are lost or the goal is missed.",
  );
});

test("a burn with a lower score may also shorten the survival", () => {
  expect(reason("kessler/survival", "harmful", -0.2)).toContain("lost earlier");
});

test("a needed burn without a higher score prevents a loss", () => {
  expect(reason("kessler/survival", "needed", -0.01)).toBe("Without it, more satellites are lost.");
  expect(reason("kessler/survival", "needed", 0.3)).toBe("Raises the score.");
  expect(reason("docking/single", "needed", 0.01)).toBe("The deputy docks only with it.");
});

test("a gain has its sign", () => {
  expect([0.0421, -0.3, 0].map(formatGain)).toEqual(["+0.042", "−0.300", "0.000"]);
});
