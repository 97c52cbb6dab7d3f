/** Rates of the failure modes of a task: their trend, and means over the cells of their profile. */
import type { FailureModeCounts } from "./api-types";

/** Change of a rate from which on it rises or falls, as a share of the overall rate. */
const NOTABLE_CHANGE = 0.1;

/** Returns the trend of a rate: more or less often than before by at least a tenth. */
export function rateTrend(of: { recent: number; overall: number } | null | undefined): string {
  if (!of || of.overall === 0) return "";
  const change = of.recent / of.overall - 1;
  return change > NOTABLE_CHANGE ? "▲ Rising" : change < -NOTABLE_CHANGE ? "▼ Falling" : "Unchanged";
}

/** Returns the mean of a value over the cells that have it, weighted by their failures; null if none has it. */
function meanOfCells(
  { cells }: FailureModeCounts,
  value: "mean_steps_left" | "avoidable_share",
): number | null {
  const known = cells.filter((cell) => typeof cell[value] === "number");
  const total = known.reduce((sum, cell) => sum + cell.count, 0);
  return total > 0 ? known.reduce((sum, cell) => sum + cell.count * (cell[value] ?? 0), 0) / total : null;
}

/** Returns the mean number of steps from the first sight of the danger to the failure, over all cells. */
export function meanStepsLeft(mode: FailureModeCounts): number | null {
  return meanOfCells(mode, "mean_steps_left");
}

/** Returns the share of avoidable failures among those with an encounter. */
export function avoidableShare(mode: FailureModeCounts): number | null {
  return meanOfCells(mode, "avoidable_share");
}

/** Returns the failure modes that occurred, the most frequent recent ones first. */
export function frequentModes(modes: FailureModeCounts[]): FailureModeCounts[] {
  return modes.filter(({ count }) => count > 0).toSorted((a, b) => b.weight - a.weight);
}
