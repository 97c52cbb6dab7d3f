/** Settings of several runs, side by side. */
import type { RunSummary } from "../lib/api-types";

/** Setting with its value in each run. */
export interface SettingRow {
  /** Path of the setting, with dots between the names. */
  path: string;
  /** Values as JSON, in the order of the runs; undefined where a run does not have the setting. */
  values: (string | undefined)[];
  /** True if the runs have different values. */
  differs: boolean;
}

/** Path of the seed, which runs that repeat a training have of their own. */
const SEED = "seed";

/** Returns the settings of a run with its seed, by path. Lists of objects with a name have the name in the path. */
export function settingsOf(run: Pick<RunSummary, "seed" | "settings">): Map<string, string> {
  const leaves = new Map<string, string>([[SEED, String(run.seed)]]);
  collect(run.settings, "", leaves);
  return leaves;
}

function collect(value: unknown, path: string, leaves: Map<string, string>) {
  const inside = (key: string) => (path ? `${path}.${key}` : key);
  const names = Array.isArray(value) ? value.map(nameOf) : [];
  if (Array.isArray(value) && names.length > 0 && names.every((name) => name !== undefined)) {
    value.forEach((item: unknown, i) => collect(item, inside(names[i] ?? ""), leaves));
  } else if (value !== null && typeof value === "object" && !Array.isArray(value)) {
    for (const [key, item] of Object.entries(value)) collect(item, inside(key), leaves);
  } else {
    leaves.set(path, JSON.stringify(value));
  }
}

function nameOf(item: unknown): string | undefined {
  if (item === null || typeof item !== "object") return undefined;
  const { task, name, id } = item as Record<string, unknown>;
  return [task, name, id].find((value) => typeof value === "string");
}

/** Returns all settings of the runs, ordered by path; the seed is first. */
export function settingsTable(runs: Pick<RunSummary, "seed" | "settings">[]): SettingRow[] {
  const all = runs.map(settingsOf);
  const paths = [...new Set(all.flatMap((settings) => [...settings.keys()]))];
  return paths
    .sort((a, b) => Number(b === SEED) - Number(a === SEED) || a.localeCompare(b))
    .map((path) => {
      const values = all.map((settings) => settings.get(path));
      return { path, values, differs: values.some((value) => value !== values[0]) };
    });
}

/** Returns the settings of a run without its seed, as a key. */
export function settingsKey(run: Pick<RunSummary, "seed" | "settings">): string {
  const rows = [...settingsOf(run)].filter(([path]) => path !== SEED);
  return JSON.stringify(rows.sort(([a], [b]) => a.localeCompare(b)));
}
