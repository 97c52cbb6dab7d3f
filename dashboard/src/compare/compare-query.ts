/** State of the comparison of runs in the address of its page. */
import type { Interval } from "../charts/shown-range.svelte";
import { DEFAULT_SMOOTHING } from "../charts/smoothing";
import { isTimeAxis, RUN_AXES, type XAxis } from "../charts/x-axis";
import { parseGrouping, type Grouping } from "./grouping";
import { BANDS, type BandKind } from "./intervals";

/** What the comparison shows. */
export interface ComparisonView {
  /** Ids of the compared runs. */
  runs: string[];
  /** Ids of those that the charts leave out. */
  hidden: string[];
  /** Task of the charts; empty for the first one. */
  task: string;
  axis: XAxis;
  /** Selected part of the axis; null for all of it. */
  selected: Interval | null;
  /** Weight of the earlier values in the curves, 0 to 0.95. */
  smoothing: number;
  grouping: Grouping;
  band: BandKind;
  /** True if the table lists settings that do not differ too. */
  allSettings: boolean;
  /** Group that evaluations are compared with; empty for the first one. */
  baseline: string;
}

/** Reads the state from the query of an address; what is missing or invalid is the default. */
export function parseComparison(query: string): ComparisonView {
  const params = new URLSearchParams(query);
  const list = (name: string) => [...new Set((params.get(name) ?? "").split(",").filter((id) => id !== ""))];
  const weight = Number(params.get("smooth") ?? NaN);
  const [from, to] = [Number(params.get("from") ?? NaN), Number(params.get("to") ?? NaN)];
  return {
    runs: list("runs"),
    hidden: list("hide"),
    task: params.get("task") ?? "",
    axis: RUN_AXES.find(([axis]) => axis === params.get("x"))?.[0] ?? "episodes",
    selected: from >= 0 && to > from && Number.isFinite(to) ? { from, to } : null,
    smoothing: weight >= 0 && weight <= 0.95 ? weight : DEFAULT_SMOOTHING,
    grouping: parseGrouping(params.get("group")),
    band: BANDS.find(([band]) => band === params.get("band"))?.[0] ?? "interval",
    allSettings: params.get("settings") === "all",
    baseline: params.get("baseline") ?? "",
  };
}

/** Returns the state as the query of an address, without the defaults. */
export function comparisonQuery(view: ComparisonView): string {
  const hidden = view.hidden.filter((id) => view.runs.includes(id));
  const { selected } = view;
  const text = (value: number) => String(Number(value.toFixed(isTimeAxis(view.axis) ? 3 : 0)));
  const params = new URLSearchParams({
    ...(hidden.length > 0 ? { hide: hidden.join(",") } : {}),
    ...(view.task ? { task: view.task } : {}),
    ...(view.axis === "episodes" ? {} : { x: view.axis }),
    ...(view.smoothing === DEFAULT_SMOOTHING ? {} : { smooth: String(view.smoothing) }),
    ...(selected ? { from: text(selected.from), to: text(selected.to) } : {}),
    ...(view.grouping === "run" ? {} : { group: view.grouping }),
    ...(view.band === "interval" ? {} : { band: view.band }),
    ...(view.allSettings ? { settings: "all" } : {}),
    ...(view.baseline ? { baseline: view.baseline } : {}),
  }).toString();
  // Ids have no characters with a meaning in addresses: commas stay readable.
  return [`runs=${view.runs.map(encodeURIComponent).join(",")}`, ...(params ? [params] : [])].join("&");
}
