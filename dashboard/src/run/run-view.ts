/** Tab and task that the page of a run shows, in the address of the page. */

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

/** Task of the charts: the id of one, `all`, or empty for the first one. */
export interface RunView {
  tab: RunTab;
  task: string;
}

/** Value of `RunView.task` for all tasks. */
export const ALL_TASKS = "all";

/** Reads tab and task from the query of an address; a missing or invalid part is the default. */
export function parseRunView(query: string): RunView {
  const params = new URLSearchParams(query);
  const tab = RUN_TABS.find(({ id }) => id === params.get("tab"))?.id ?? "learning";
  return { tab, task: params.get("task") ?? "" };
}

/** Returns tab and task as the query of an address; empty for the defaults. */
export function runViewQuery({ tab, task }: RunView): string {
  const pairs = [tab === "learning" ? "" : `tab=${tab}`, task ? `task=${encodeURI(task)}` : ""];
  return pairs.filter((pair) => pair !== "").join("&");
}

/** Returns the tasks to show: the chosen one, or the first one if the choice is none of them. */
export function chosenTasks<T extends { task: string }>(tasks: T[], task: string): T[] {
  if (task === ALL_TASKS) return tasks;
  const chosen = tasks.find((row) => row.task === task) ?? tasks[0];
  return chosen ? [chosen] : [];
}
