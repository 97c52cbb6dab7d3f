/** Setting whose value differs between two versions of the settings. */
export interface Difference {
  /** Path of the setting, with dots between the names. */
  path: string;
  before: string;
  after: string;
}

function collectLeaves(value: unknown, path: string, leaves: Map<string, string>) {
  if (value !== null && typeof value === "object" && !Array.isArray(value)) {
    for (const [key, inner] of Object.entries(value))
      collectLeaves(inner, path ? `${path}.${key}` : key, leaves);
  } else {
    leaves.set(path, JSON.stringify(value));
  }
}

/** Lists the leaves that differ between two settings objects. */
export function findDifferences(before: unknown, after: unknown): Difference[] {
  const [oldLeaves, newLeaves] = [new Map<string, string>(), new Map<string, string>()];
  collectLeaves(before, "", oldLeaves);
  collectLeaves(after, "", newLeaves);
  return [...new Set([...oldLeaves.keys(), ...newLeaves.keys()])]
    .filter((path) => oldLeaves.get(path) !== newLeaves.get(path))
    .map((path) => ({ path, before: oldLeaves.get(path) ?? "–", after: newLeaves.get(path) ?? "–" }));
}
