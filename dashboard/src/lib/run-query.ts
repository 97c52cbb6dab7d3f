/** View of the list of runs: search, filters, order, groups and columns, as the address of the page has them. */
import type { RunActivity } from "./api-types";

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
  tasks: { name: "Tasks", rem: 7, grows: true },
  episodes: { name: "Episodes", rem: 5.5, sort: "episodes", number: true },
  skill: { name: "Skill", rem: 3.5, sort: "skill", number: true },
  curve: { name: "Skill over time", rem: 7.5 },
  levels: { name: "Levels", rem: 9, grows: true },
  last_results: { name: "Latest results", rem: 6.5, sort: "last_results" },
  created: { name: "Created", rem: 6, sort: "created" },
  tags: { name: "Tags", rem: 7, grows: true },
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
  "skill",
  "curve",
  "last_results",
  "created",
  "tags",
];

export interface RunView {
  search: string;
  activity: RunActivity | "";
  tag: string;
  strategy: string;
  sort: Sort;
  descending: boolean;
  group: Grouping | "";
  columns: Column[];
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
  };
}

/** Direction in which users read a value first: names from A, all others from the highest. */
export function defaultOrder(sort: Sort): "asc" | "desc" {
  return sort === "name" ? "asc" : "desc";
}

/** Formats a view as the query of an address, without values that are the default. */
export function formatView(view: RunView): string {
  const params = new URLSearchParams();
  for (const name of ["search", "activity", "tag", "strategy", "group"] as const)
    if (view[name]) params.set(name, view[name]);
  if (view.sort !== "created") params.set("sort", view.sort);
  const order = view.descending ? "desc" : "asc";
  if (order !== defaultOrder(view.sort)) params.set("order", order);
  if (view.columns.join() !== DEFAULT_COLUMNS.join()) params.set("columns", view.columns.join());
  return params.toString();
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
  const [tick, name, actions, gap, padding] = [1.2, 10, 7.2, 0.75, 1];
  const specs: ColumnSpec[] = columns.map((column) => COLUMNS[column]);
  const width = specs.reduce((sum, { rem }) => sum + rem + gap, tick + name + actions + 2 * gap + padding);
  const middle = specs.map(({ rem, grows }) =>
    grows ? `minmax(${String(rem)}rem, 1fr)` : `${String(rem)}rem`,
  );
  const template = [
    `${String(tick)}rem`,
    `minmax(${String(name)}rem, 2fr)`,
    ...middle,
    `${String(actions)}rem`,
  ];
  return { template: template.join(" "), width: `${String(Math.ceil(width))}rem` };
}

/** Address of the page that compares runs. */
export function comparisonAddress(runs: readonly string[]): string {
  return `#/compare?runs=${runs.map(encodeURIComponent).join(",")}`;
}
