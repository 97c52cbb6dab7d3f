/** Difference of the means of two groups of runs, with the interval that the variation of the seeds leaves. */
import { MIN_INTERVAL, tQuantile } from "./intervals";

/** Difference of two means with its 95 % interval. */
export interface MeanDifference {
  difference: number;
  low: number;
  high: number;
}

/**
 * Returns the mean of `values` minus that of `base` with Welch's interval (Welch 1947, "The generalization of Student's problem when
 * several different population variances are involved", p. 28–35); undefined if a group has fewer than three values.
 */
export function meanDifference(values: number[], base: number[]): MeanDifference | undefined {
  if (values.length < MIN_INTERVAL || base.length < MIN_INTERVAL) return undefined;
  const [a, b] = [moments(values), moments(base)];
  const difference = a.mean - b.mean;
  const variance = a.variance + b.variance;
  if (variance === 0) return { difference, low: difference, high: difference };
  const degrees = variance ** 2 / (a.variance ** 2 / (a.n - 1) + b.variance ** 2 / (b.n - 1));
  const half = quantile(degrees) * Math.sqrt(variance);
  return { difference, low: difference - half, high: difference + half };
}

/** True if the interval excludes 0: the seeds alone do not explain the difference. */
export function isReal({ low, high }: MeanDifference): boolean {
  return low > 0 || high < 0;
}

/** Returns the 97.5 % quantile for a fractional number of degrees: a line over 1/degrees, which is never too small. */
function quantile(degrees: number): number {
  const low = Math.max(1, Math.floor(degrees));
  const weight = (1 / degrees - 1 / (low + 1)) / (1 / low - 1 / (low + 1));
  return tQuantile(low + 1) + Math.min(1, weight) * (tQuantile(low) - tQuantile(low + 1));
}

/** Mean of the values, and the variance of this mean. */
function moments(values: number[]): { n: number; mean: number; variance: number } {
  const n = values.length;
  const mean = values.reduce((sum, value) => sum + value, 0) / n;
  const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  return { n, mean, variance: squares / (n - 1) / n };
}
