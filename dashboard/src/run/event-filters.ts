/** Filters of the list of events: their names, and the kinds of events as the server filters them. */
export const EVENT_FILTERS = [
  { id: "all", kinds: "", name: "all" },
  { id: "moves", kinds: "move", name: "level moves" },
  { id: "warnings", kinds: "warning", name: "warnings" },
  { id: "failures", kinds: "design,failures", name: "failures and designs" },
  { id: "results", kinds: "group,claim", name: "results" },
  { id: "leases", kinds: "lease", name: "leases" },
  { id: "workers", kinds: "worker", name: "workers" },
  { id: "status", kinds: "run", name: "status and settings" },
] as const;

export type EventFilter = (typeof EVENT_FILTERS)[number]["id"];

/** Returns the kinds of events of a filter; empty for all. */
export function kindsOf(filter: EventFilter): string {
  return EVENT_FILTERS.find(({ id }) => id === filter)?.kinds ?? "";
}
