/** Values of groups of runs at their ends: means, differences to a baseline, and what these differences say. */
import { countOf } from "../lib/format";
import { finalValue, type Quantity, type RunPoints } from "./curves";
import { MIN_INTERVAL, type Bounds } from "./intervals";
import { isReal, meanDifference } from "./welch";

/** Quantity of a comparison, with its labels and its bounds. */
export interface QuantitySpec extends Bounds {
  quantity: Quantity;
  name: string;
  axis: string;
  format: (value: number) => string;
}

/** Returns the values at the ends of the runs that have points. */
export function finalValues(runs: RunPoints[]): number[] {
  return runs.map(finalValue).filter((value) => value !== null);
}

/** Returns a difference to the baseline as text, with its 95 % interval where both groups have enough runs. */
export function differenceText(
  values: number[],
  base: number[],
  format: (value: number) => string,
): { text: string; isReal: boolean } {
  if (values.length === 0 || base.length === 0) return { text: "–", isReal: false };
  const signed = (value: number) => `${value < 0 ? "−" : "+"}${format(Math.abs(value))}`;
  const found = meanDifference(values, base);
  if (found) {
    const { difference, low, high } = found;
    return { text: `${signed(difference)} [${signed(low)}, ${signed(high)}]`, isReal: isReal(found) };
  }
  const mean = (all: number[]) => all.reduce((sum, value) => sum + value, 0) / all.length;
  return { text: signed(mean(values) - mean(base)), isReal: false };
}

/** Visible group of a comparison with the values of each quantity at the ends of its runs. */
export interface GroupEnd {
  label: string;
  /** Number of visible runs. */
  runs: number;
  values: Map<Quantity, number[]>;
}

/**
 * Returns in one sentence what the ends of the runs say: which group is ahead of the baseline beyond the variation of its seeds. A
 * group is ahead in the first quantity of `order` whose difference is real.
 */
export function conclusion(groups: GroupEnd[], base: GroupEnd | undefined, order: QuantitySpec[]): string {
  const others = groups.filter((group) => group !== base);
  if (!base || others.length === 0) return "";
  const few = groups.filter(({ runs }) => runs < MIN_INTERVAL);
  if (few.length > 0) {
    const who = groups.every(({ runs }) => runs === 1)
      ? "Single runs have no interval"
      : `${few.map(({ label, runs }) => `${label} (${countOf(runs, "run")})`).join(", ")}: too few runs for an interval`;
    return `${who}: a difference can come from the seed alone. Group at least ${String(MIN_INTERVAL)} runs that differ by their seeds, or compare evaluations.`;
  }
  const sentences = others.map((group) => {
    for (const { quantity, name, format } of order) {
      const [values, of] = [group.values.get(quantity) ?? [], base.values.get(quantity) ?? []];
      const difference = differenceText(values, of, format);
      if (!difference.isReal) continue;
      const side = difference.text.startsWith("−") ? "below" : "above";
      return `${group.label} ends ${side} ${base.label} in ${name.toLowerCase()}, by ${difference.text.slice(1)}.`;
    }
    return `${group.label} and ${base.label} do not differ beyond their seeds.`;
  });
  return sentences.join(" ");
}
