/** Failures that the page of a run lists: of a mode, or of a cell of its rose chart. The address has them. */
export interface FailureSelection {
  task: string;
  mode: string;
  /** Sector of the angle, from 0. */
  sector?: number;
  /** Band of the relative speed, from 0. */
  band?: number;
}

function wholeNumber(text: string | null | undefined): number | undefined {
  return text && /^\d{1,3}$/.test(text) ? Number(text) : undefined;
}

/** Reads the selection from the query of an address; null without a task and a mode. */
export function failureSelection(query: URLSearchParams | null): FailureSelection | null {
  const [task, mode] = [query?.get("task"), query?.get("mode")];
  if (!task || !mode) return null;
  const [sector, band] = [wholeNumber(query?.get("sector")), wholeNumber(query?.get("band"))];
  return {
    task,
    mode,
    ...(sector === undefined ? {} : { sector, ...(band === undefined ? {} : { band }) }),
  };
}

/** Returns the parameters of the address. */
export function selectionParams({ task, mode, sector, band }: FailureSelection): [string, string][] {
  return [
    ["task", task],
    ["mode", mode],
    ["sector", sector === undefined ? "" : String(sector)],
    ["band", band === undefined ? "" : String(band)],
  ];
}
