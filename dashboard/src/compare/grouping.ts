/** Groups of runs that a comparison averages. */
import type { RunSummary } from "../lib/api-types";
import { settingsKey, settingsOf, settingsTable } from "./settings-table";

type GroupedRun = Pick<RunSummary, "id" | "name" | "seed" | "tags" | "settings">;

/** Runs that are averaged. */
export interface RunGroup {
  /** Name of the group, unique in the comparison. */
  label: string;
  /** Ids of the runs. */
  runs: string[];
}

/** Choices of the grouping, `run` for no groups. `setting:PATH` groups by the value of a setting. */
export type Grouping = "run" | "settings" | "tags" | `setting:${string}`;

/** Returns the grouping that a text names; other texts group nothing. */
export function parseGrouping(text: string | null): Grouping {
  if (text === "settings" || text === "tags") return text;
  return text?.startsWith("setting:") ? (text as `setting:${string}`) : "run";
}

/** Returns the text of a JSON value without the quotes of a string. */
export function plainValue(json: string | undefined): string {
  if (json === undefined) return "–";
  return json.startsWith('"') ? (JSON.parse(json) as string) : json;
}

/** Groups the runs in the order of their first members. */
export function groupRuns(runs: GroupedRun[], grouping: Grouping): RunGroup[] {
  const common = new Set(runs[0]?.tags.filter((tag) => runs.every(({ tags }) => tags.includes(tag))));
  const keyOf = (run: GroupedRun) => {
    if (grouping === "settings") return `${settingsKey(run)} ${separatingTags(run, common)}`;
    if (grouping === "tags") return separatingTags(run, common) || "without a tag";
    if (grouping === "run") return run.id;
    return plainValue(settingsOf(run).get(grouping.slice("setting:".length)));
  };
  const groups = new Map<string, GroupedRun[]>();
  for (const run of runs) groups.set(keyOf(run), [...(groups.get(keyOf(run)) ?? []), run]);
  const labels = [...groups].map(([key, members]) =>
    grouping === "run"
      ? runLabel(members[0], runs)
      : grouping === "settings"
        ? settingsLabel(members[0], runs, common)
        : key,
  );
  return [...groups.values()].map((members, i) => ({
    label: unique(labels, i),
    runs: members.map(({ id }) => id),
  }));
}

/** Returns the name of a run; runs with the same name have their seed, and their id if that is not enough. */
export function runLabel(run: GroupedRun | undefined, runs: GroupedRun[]): string {
  if (!run) return "";
  const same = runs.filter(({ name }) => name === run.name);
  if (same.length < 2) return run.name;
  const isSeedUnique = same.filter(({ seed }) => seed === run.seed).length < 2;
  return isSeedUnique ? `${run.name}, seed ${String(run.seed)}` : `${run.name}, ${run.id}`;
}

/** Tag that numbers the repetitions of a training, such as seed-3. */
const SEED_TAG = /^seed[-_:= ]?\d+$/i;

/** Returns the tags that separate a run from others, as text: not those that all runs have, or that name a seed. */
function separatingTags({ tags }: GroupedRun, common: Set<string>): string {
  return tags.filter((tag) => !common.has(tag) && !SEED_TAG.test(tag)).join(", ");
}

/** Returns the tags and settings of a group that other groups have in other ways, or the common name of its runs. */
function settingsLabel(run: GroupedRun | undefined, runs: GroupedRun[], common: Set<string>): string {
  if (!run) return "";
  const tags = separatingTags(run, common);
  const position = runs.indexOf(run);
  const rows = settingsTable(runs).filter(({ path, differs }) => differs && path !== "seed");
  if (rows.length === 0) return tags || run.name;
  const short = rows.filter(({ values }) => (values[position]?.length ?? 0) <= 24).slice(0, 3);
  const parts = short.map(
    ({ path, values }) => `${path.split(".").pop() ?? path} ${plainValue(values[position])}`,
  );
  return [tags, ...parts].filter((part) => part !== "").join(", ") || run.name;
}

function unique(labels: string[], i: number): string {
  const label = labels[i] ?? "";
  const before = labels.slice(0, i).filter((other) => other === label).length;
  return before > 0 ? `${label} (${String(before + 1)})` : label;
}
