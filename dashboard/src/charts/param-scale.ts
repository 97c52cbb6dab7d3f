/** Params of a task on one scale of difficulty, so that a single chart shows all of them. */
import type { LevelTable, TaskParam, TaskSeries } from "../lib/api-types";
import { significant } from "../lib/format";
import type { Curve } from "./series";

const COLOURS = ["--c0", "--c1", "--c2", "--c3", "--c4", "--c5"];
/** Number of params up to which a chart also shows the range of their values. */
const MAX_BANDS = 3;

/** Ends of the scale of a param: its easiest and its hardest value. */
export interface ParamEnds {
  easiest: number;
  hardest: number;
}

/** Returns the ends of a param: the first and the last row of the level table if they differ, else its valid values. */
export function paramEnds(spec: TaskParam, levels: LevelTable): ParamEnds {
  const column = levels.columns.indexOf(spec.name);
  const [first, last] = [levels.rows[0]?.[column], levels.rows.at(-1)?.[column]];
  if (first !== undefined && last !== undefined && first !== last) return { easiest: first, hardest: last };
  return spec.harder === "up"
    ? { easiest: spec.min, hardest: spec.max }
    : { easiest: spec.max, hardest: spec.min };
}

/** Returns the difficulty of a value: 0 at the easiest, 1 at the hardest end; beyond the ends it continues. */
export function difficulty(value: number, { easiest, hardest }: ParamEnds): number {
  return hardest === easiest ? 0 : (value - easiest) / (hardest - easiest) + 0; // + 0 turns −0 into 0
}

/** Returns the label of a param with its unit. */
export function paramLabel({ name, unit }: Pick<TaskParam, "name" | "unit">): string {
  return `${name.replaceAll("_", " ")}${unit && unit !== name ? ` (${unit})` : ""}`;
}

/** Returns the names of the params that are not constant in a series. */
export function changingParams({ params }: Pick<TaskSeries, "params">): string[] {
  return Object.entries(params)
    .filter(([, { low, high }]) => {
      const known = [...low, ...high].filter((value) => value !== null);
      return known.some((value) => value !== known[0]);
    })
    .map(([name]) => name);
}

/** Returns a curve for each changing param: its mean as difficulty, with the values in their unit as the source. */
export function paramCurves(
  series: Pick<TaskSeries, "params">,
  specs: TaskParam[],
  levels: LevelTable,
): Curve[] {
  const names = changingParams(series);
  return names.flatMap((name, i) => {
    const [spec, values] = [specs.find((spec) => spec.name === name), series.params[name]];
    if (!spec || !values) return [];
    const ends = paramEnds(spec, levels);
    const scaled = (column: (number | null)[]) =>
      column.map((value) => (value === null ? null : difficulty(value, ends)));
    return {
      label: paramLabel(spec),
      colour: COLOURS[i % COLOURS.length] ?? "--c0",
      dashed: i >= COLOURS.length,
      values: scaled(values.mean),
      ...(names.length <= MAX_BANDS
        ? { low: scaled(values.low), high: scaled(values.high), bounds: "minimum to maximum" }
        : {}),
      source: { values: values.mean, low: values.low, high: values.high, format: significant },
    };
  });
}
