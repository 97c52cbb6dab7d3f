/** Values of groups of runs at their ends: means, differences to a baseline, and what these differences say. */
import { countOf, fixed, percent, points, signed } from "../lib/format";
import { SKILL_WINDOWS } from "../lib/skill-windows";
import { finalValue, type Quantity, type RunPoints } from "./curves";
import { MIN_INTERVAL, type Bounds } from "./intervals";
import { isReal, meanDifference } from "./welch";

/** Quantity of a comparison, with its labels and its bounds. */
export interface QuantitySpec extends Bounds {
  quantity: Quantity;
  name: string;
  axis: string;
  /** Name of the value at the end of a run, with its window. */
  end: string;
  format: (value: number) => string;
  /** Formats the size of a difference; by default as a value. */
  formatDifference?: (size: number) => string;
}

const levelText = (level: number) => (Number.isInteger(level) ? String(level) : fixed(level, 1));

/** Quantities of a comparison, in the order in which they decide which runs are ahead. */
export const QUANTITIES: QuantitySpec[] = [
  { quantity: "level", name: "Level", axis: "level", end: "Level at the end", min: 0, format: levelText },
  {
    quantity: "rung",
    name: "Mean rung",
    axis: "mean rung",
    end: "Mean rung, last tenth",
    min: 0,
    format: (value) => fixed(value, 1),
  },
  {
    quantity: "success",
    name: "Success rate",
    axis: "success rate",
    end: "Success rate, last tenth",
    min: 0,
    max: 1,
    format: percent,
    formatDifference: points,
  },
  {
    quantity: "skill",
    name: "Skill",
    axis: SKILL_WINDOWS.point.name,
    end: SKILL_WINDOWS.lastTenth.name,
    format: (value) => fixed(value),
  },
];

/** Returns the values at the ends of the runs that have points. */
export function finalValues(runs: RunPoints[]): number[] {
  return runs.map(finalValue).filter((value) => value !== null);
}

/** Returns a difference to the baseline as text, with its 95 % interval where both groups have enough runs. */
export function differenceText(
  values: number[],
  base: number[],
  { format, formatDifference = format }: Pick<QuantitySpec, "format" | "formatDifference">,
): { text: string; isReal: boolean } {
  if (values.length === 0 || base.length === 0) return { text: "–", isReal: false };
  const text = (difference: number) => signed(difference, formatDifference);
  const found = meanDifference(values, base);
  if (found) {
    const { difference, low, high } = found;
    return { text: `${text(difference)} [${text(low)}, ${text(high)}]`, isReal: isReal(found) };
  }
  return { text: text(meanOf(values) - meanOf(base)), isReal: false };
}

function meanOf(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/** Returns the mean over the tasks of a run, each with its value at the end; null if a task has none. */
export function meanOverTasks(values: readonly (number | null)[]): number | null {
  const known = values.filter((value) => value !== null);
  return known.length === values.length && known.length > 0 ? meanOf(known) : null;
}

/** Orders groups: those with the highest level first, then those with the highest skill. Groups without a value come last. */
export function bestFirst(groups: readonly GroupEnd[]): GroupEnd[] {
  const value = ({ values }: GroupEnd, quantity: Quantity) => {
    const known = values.get(quantity) ?? [];
    return known.length > 0 ? meanOf(known) : -Infinity;
  };
  const compare = (a: GroupEnd, b: GroupEnd, quantity: Quantity) => {
    const [of, other] = [value(a, quantity), value(b, quantity)];
    return of === other ? 0 : other - of;
  };
  return groups.toSorted((a, b) => compare(a, b, "level") || compare(a, b, "skill"));
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
    for (const spec of order) {
      const { quantity, name } = spec;
      const [values, of] = [group.values.get(quantity) ?? [], base.values.get(quantity) ?? []];
      const difference = differenceText(values, of, spec);
      if (!difference.isReal) continue;
      const side = difference.text.startsWith("−") ? "below" : "above";
      return `${group.label} ends ${side} ${base.label} in ${name.toLowerCase()}, by ${difference.text.slice(1)}.`;
    }
    return `${group.label} and ${base.label} do not differ beyond their seeds.`;
  });
  return sentences.join(" ");
}
