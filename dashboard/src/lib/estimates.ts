/** Labels and number formats of the estimates of evaluations. */
import { signed } from "./format";
import type { Estimate, EvaluationEstimates, SuiteSection } from "./api-types";

export const MEASURES = [
  "success",
  "score",
  "skill",
  "lost",
  "fuel_used",
  "cvar10",
] as const satisfies readonly (keyof EvaluationEstimates)[];
export type Measure = (typeof MEASURES)[number];

export const MEASURE_LABELS: Record<Measure, string> = {
  success: "Success rate",
  score: "Score",
  skill: "Skill",
  lost: "Agents lost",
  fuel_used: "Fuel used",
  cvar10: "CVaR (worst 10 %)",
};

export const PART_LABELS: Record<SuiteSection, string> = {
  contested: "contested",
  as_they_come: "unfiltered",
  all: "all",
};

const shares = new Set<string>(["success", "lost", "improvement"]);

/** Formats an estimate with its interval: "62 % [58, 66]" or "0.71 [0.68, 0.74]". */
export function formatEstimate(measure: string, estimate: Estimate | null | undefined): string {
  if (!estimate) return "–";
  const share = shares.has(measure);
  const number = (value: number) =>
    share ? (100 * value).toFixed(1) : value.toFixed(measure === "fuel_used" ? 1 : 3);
  return `${number(estimate.mean)}${share ? " %" : ""} [${number(estimate.low)}, ${number(estimate.high)}]`;
}

/** Formats a difference of two estimates with its interval: "+2.0 pp [−1.0, +5.0]" or "+0.02 [−0.01, +0.05]". */
export function formatDifference(measure: string, estimate: Estimate | null | undefined): string {
  if (!estimate) return "–";
  const isShare = shares.has(measure);
  const number = (value: number) =>
    signed(isShare ? 100 * value : value, (size) => size.toFixed(isShare ? 1 : 3));
  return `${number(estimate.mean)}${isShare ? " pp" : ""} [${number(estimate.low)}, ${number(estimate.high)}]`;
}
