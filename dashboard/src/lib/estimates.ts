/** Estimate of an evaluation with its interval. */
export interface Estimate {
  mean: number;
  low: number;
  high: number;
  scenarios: number;
}

export const MEASURES = ["success", "score", "skill", "lost", "fuel_used", "cvar10"] as const;
export type Measure = (typeof MEASURES)[number];

export interface ReportRow extends Record<Measure, Estimate | null> {
  task: string;
  part: "contested" | "as_they_come" | "all";
  policy: string;
  scenarios: number;
}

export interface ComparisonRow {
  task: string;
  part: ReportRow["part"];
  policy: string;
  scenarios: number;
  score: Estimate | null;
  success: Estimate | null;
  skill: Estimate | null;
  improvement: Estimate | null;
}

export const MEASURE_LABELS: Record<Measure, string> = {
  success: "Success",
  score: "Score",
  skill: "Skill",
  lost: "Agents lost",
  fuel_used: "Fuel used",
  cvar10: "Worst tenth",
};

export const PART_LABELS: Record<ReportRow["part"], string> = {
  contested: "contested",
  as_they_come: "as they come",
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
