/** Shards in the ids of runs: servers that divide the runs of a team. */
import type { MissingShard } from "./api-types";

/** Returns the shard that an id begins with; an empty text for an id without a shard. */
export function shardOf(id: string): string {
  const dot = id.indexOf(".");
  return dot > 0 ? id.slice(0, dot) : "";
}

/** Groups ids by their shards, in the order of their first ids. */
export function groupByShard(ids: readonly string[]): string[][] {
  const groups = new Map<string, string[]>();
  for (const id of ids) {
    const shard = shardOf(id);
    const group = groups.get(shard);
    if (group) group.push(id);
    else groups.set(shard, [id]);
  }
  return [...groups.values()];
}

/** Joins the missing shards of several lists; each shard is named once. */
export function joinMissing(lists: readonly (readonly MissingShard[])[]): MissingShard[] {
  const known = new Map<string, MissingShard>();
  for (const missing of lists.flat()) if (!known.has(missing.shard)) known.set(missing.shard, missing);
  return [...known.values()];
}
