/** Tab, task and filters that the page of a run shows, in the address of the page. */
import { EVENT_FILTERS, type EventFilter } from "./event-filters";

/** Tabs of the page of a run, in their order. */
export const RUN_TABS = [
  { id: "learning", name: "Learning" },
  { id: "parameters", name: "Parameters" },
  { id: "failures", name: "Failures & designs" },
  { id: "trainer", name: "Trainer" },
  { id: "activity", name: "Activity" },
  { id: "settings", name: "Settings" },
] as const;

export type RunTab = (typeof RUN_TABS)[number]["id"];

/** What the page of a run shows. */
export interface RunView {
  tab: RunTab;
  /** Task of the charts: the id of one, `all`, or empty for the first one. */
  task: string;
  /** Kind of the listed events. */
  events: EventFilter;
  /** Words in the names of the listed metrics; empty for all. */
  metrics: string;
}

/** Value of `RunView.task` for all tasks. */
export const ALL_TASKS = "all";

/** Reads the view from the query of an address; a missing or invalid part is the default. */
export function parseRunView(query: string): RunView {
  const params = new URLSearchParams(query);
  return {
    tab: RUN_TABS.find(({ id }) => id === params.get("tab"))?.id ?? "learning",
    task: params.get("task") ?? "",
    events: EVENT_FILTERS.find(({ id }) => id === params.get("events"))?.id ?? "all",
    metrics: params.get("metrics") ?? "",
  };
}

/** Returns the view as the query of an address; empty for the defaults. */
export function runViewQuery({ tab, task, events, metrics }: RunView): string {
  const pairs = [
    tab === "learning" ? "" : `tab=${tab}`,
    task ? `task=${encodeURIComponent(task).replaceAll("%2F", "/")}` : "",
    events === "all" ? "" : `events=${events}`,
    metrics ? `metrics=${encodeURIComponent(metrics).replaceAll("%2F", "/")}` : "",
  ];
  return pairs.filter((pair) => pair !== "").join("&");
}

/** Returns true if the back button must lead from `next` to `current`: the user chose another part of the page, not a word of a search. */
export function isOtherPlace(current: RunView, next: RunView): boolean {
  return current.tab !== next.tab || current.task !== next.task || current.events !== next.events;
}

/** Returns the tasks to show: the chosen one, or the first one if the choice is none of them. */
export function chosenTasks<T extends { task: string }>(tasks: T[], task: string): T[] {
  if (task === ALL_TASKS) return tasks;
  const chosen = tasks.find((row) => row.task === task) ?? tasks[0];
  return chosen ? [chosen] : [];
}
