/** View of the list of runs: search, filters, order, groups and columns, as the address of the page has them. */
import type { RunActivity } from "./api-types";
import { addressOf } from "./page-history";
import { SKILL_WINDOWS } from "./skill-windows";

export const ACTIVITIES = [
  "running",
  "waiting",
  "idle",
  "paused",
  "archived",
] as const satisfies readonly RunActivity[];
export const SORTS = ["created", "name", "episodes", "last_results", "skill"] as const;
export type Sort = (typeof SORTS)[number];
export const GROUPINGS = ["strategy", "tasks", "tag", "activity"] as const;
export type Grouping = (typeof GROUPINGS)[number];

interface ColumnSpec {
  name: string;
  /** What the values are, for the title of the head. */
  title?: string;
  /** Smallest width, in rem. */
  rem: number;
  /** True if the column takes a part of the free width. */
  grows?: true;
  sort?: Sort;
  number?: true;
}

/** Columns of the table beside the name of the run, in their order. */
export const COLUMNS = {
  activity: { name: "Activity", rem: 5.5 },
  strategy: { name: "Strategy", rem: 5.5 },
  tasks: { name: "Tasks", rem: 6, grows: true },
  episodes: { name: "Episodes", rem: 5.5, sort: "episodes", number: true },
  levels: {
    name: "Level",
    title: "Current level of the run; a range if its tasks have different levels",
    rem: 4,
    number: true,
  },
  skill: { ...SKILL_WINDOWS.recent, rem: 4, sort: "skill", number: true },
  curve: { name: "Skill over time", title: "Mean skill of all tasks over the time of the run", rem: 6.5 },
  last_results: { name: "Latest results", rem: 6.5, sort: "last_results" },
  created: { name: "Created", rem: 6.5, sort: "created" },
  tags: { name: "Tags", rem: 8, grows: true },
  note: { name: "Note", rem: 10, grows: true },
  group_size: { name: "Group size", rem: 4.5, number: true },
  seed: { name: "Seed", rem: 9.5, number: true },
  policy_version: { name: "Policy version", rem: 6.5, number: true },
  owner: { name: "Owner", rem: 6 },
} as const satisfies Record<string, ColumnSpec>;
export type Column = keyof typeof COLUMNS;
export const ALL_COLUMNS = Object.keys(COLUMNS) as Column[];
const DEFAULT_COLUMNS: readonly Column[] = [
  "activity",
  "strategy",
  "tasks",
  "episodes",
  "levels",
  "skill",
  "curve",
  "last_results",
  "created",
  "tags",
];

/** Largest number of runs of a comparison: each has three requests and a curve in every chart. The address holds as many selected runs. */
export const MAX_COMPARED = 100;

/** Open dialog of the page: of a new run, of the selected runs that are deleted, or of the tags and the note of a run. */
export type RunDialog = "" | "new" | "delete" | `edit:${string}`;

export interface RunView {
  search: string;
  activity: RunActivity | "";
  tag: string;
  strategy: string;
  sort: Sort;
  descending: boolean;
  group: Grouping | "";
  columns: Column[];
  /** Ids of the selected runs. */
  selected: string[];
  dialog: RunDialog;
}

/** Filters of the API, by the names of its parameters. */
export interface RunFilters {
  search?: string;
  activity?: RunActivity;
  tag?: string;
  strategy?: string;
  tasks?: string;
}

function word<T extends string>(value: string | null, known: readonly T[]): T | undefined {
  return known.find((one) => one === value);
}

/** Reads a view from the query of an address. Unknown words are left out. */
export function parseView(query: string): RunView {
  const params = new URLSearchParams(query);
  const sort = word(params.get("sort"), SORTS) ?? "created";
  const columns = params.get("columns");
  const selected = [...new Set((params.get("selected") ?? "").split(",").filter((id) => id !== ""))];
  return {
    search: params.get("search") ?? "",
    activity: word(params.get("activity"), ACTIVITIES) ?? "",
    tag: params.get("tag") ?? "",
    strategy: params.get("strategy") ?? "",
    sort,
    descending: (params.get("order") ?? defaultOrder(sort)) === "desc",
    group: word(params.get("group"), GROUPINGS) ?? "",
    columns:
      columns === null
        ? [...DEFAULT_COLUMNS]
        : ALL_COLUMNS.filter((column) => columns.split(",").includes(column)),
    selected,
    dialog: parseDialog(params.get("dialog") ?? "", selected),
  };
}

/** Returns the dialog that a word names; a deletion needs selected runs. */
function parseDialog(word: string, selected: readonly string[]): RunDialog {
  if (word === "new" || (word === "delete" && selected.length > 0)) return word;
  return word.startsWith("edit:") ? (word as RunDialog) : "";
}

/** Direction in which users read a value first: names from A, all others from the highest. */
export function defaultOrder(sort: Sort): "asc" | "desc" {
  return sort === "name" ? "asc" : "desc";
}

/** Returns the address of a view, without values that are the default, and without a selection that is too long for it. */
export function viewAddress(view: RunView): string {
  const order = view.descending ? "desc" : "asc";
  const hasColumns = view.columns.join() !== DEFAULT_COLUMNS.join();
  const params = new URLSearchParams({
    search: view.search,
    activity: view.activity,
    tag: view.tag,
    strategy: view.strategy,
    group: view.group,
    sort: view.sort === "created" ? "" : view.sort,
    order: order === defaultOrder(view.sort) ? "" : order,
    selected: view.selected.length <= MAX_COMPARED ? view.selected.join() : "",
    dialog: view.dialog === "delete" && view.selected.length > MAX_COMPARED ? "" : view.dialog,
  });
  const address = addressOf("/", params);
  // A table without columns has an empty list, which differs from none.
  if (!hasColumns) return address;
  return `${address}${address.includes("?") ? "&" : "?"}columns=${view.columns.join()}`;
}

/** Returns the filters of a view for the API. */
export function filtersOf(view: RunView): RunFilters {
  return {
    ...(view.search.trim() ? { search: view.search.trim() } : {}),
    ...(view.activity ? { activity: view.activity } : {}),
    ...(view.tag ? { tag: view.tag } : {}),
    ...(view.strategy ? { strategy: view.strategy } : {}),
  };
}

/** Returns the view after a click on the head of a column: sorted by it, or in the other direction. */
export function sortBy(view: RunView, sort: Sort): RunView {
  const descending = view.sort === sort ? !view.descending : defaultOrder(sort) === "desc";
  return { ...view, sort, descending };
}

/** Returns the filter that selects the runs of a group. */
export function groupFilter(group: Grouping | "", value: string): RunFilters {
  return group ? { [group]: value } : {};
}

/** Formats the value of a group. */
export function groupName(group: Grouping | "", value: string): string {
  if (value === "") return group === "tag" ? "no tags" : "–";
  return group === "tasks" ? value.split(",").join(", ") : value;
}

/** Returns the columns of the grid of the table, with those for the tick, the name and the actions, and their smallest width. */
export function tableColumns(columns: readonly Column[]): { template: string; width: string } {
  const [tick, name, actions, gap, padding] = [1.2, 12, 7.2, 0.75, 1];
  const specs: ColumnSpec[] = columns.map((column) => COLUMNS[column]);
  const width = specs.reduce((sum, { rem }) => sum + rem + gap, tick + name + actions + 2 * gap + padding);
  const middle = specs.map(({ rem, grows }) =>
    grows ? `minmax(${String(rem)}rem, 1fr)` : `${String(rem)}rem`,
  );
  const template = [
    `${String(tick)}rem`,
    `minmax(${String(name)}rem, 5fr)`,
    ...middle,
    `${String(actions)}rem`,
  ];
  return { template: template.join(" "), width: `${String(Math.ceil(width))}rem` };
}

/** Address of the page that compares runs. */
export function comparisonAddress(runs: readonly string[]): string {
  return `#/compare?runs=${runs.map(encodeURIComponent).join(",")}`;
}
