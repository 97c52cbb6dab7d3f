import { expect, test } from "vitest";
import { groupByShard, joinMissing, shardOf } from "./shards";

test("the shard of an id is the text before its dot", () => {
  expect(["east.run-1", "run-1", ".run", ""].map(shardOf)).toEqual(["east", "", "", ""]);
});

test("ids are grouped by shard in their order", () => {
  expect(groupByShard([])).toEqual([]);
  expect(groupByShard(["b.1", "a.1", "old", "b.2"])).toEqual([["b.1", "b.2"], ["a.1"], ["old"]]);
});

test("a shard that several lists miss is named once", () => {
  const [east, west] = [
    { shard: "east", reason: "x" },
    { shard: "west", reason: "y" },
  ];
  expect(joinMissing([[west], [], [west, east]])).toEqual([west, east]);
});
