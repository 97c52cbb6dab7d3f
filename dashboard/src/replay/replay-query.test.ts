import { expect, test } from "vitest";
import { parseReplayQuery, queryOfOtherEpisode, replayQuery } from "./replay-query";

test("a view is read from the address that has it", () => {
  const view = { step: 12, speed: 20, agent: 1, compared: "reference" } as const;
  expect(replayQuery(view)).toBe("step=12&speed=20&agent=1&beside=reference");
  expect(parseReplayQuery(replayQuery(view))).toEqual(view);
  expect(queryOfOtherEpisode(view)).toBe("?speed=20&agent=1&beside=reference");
});

test("missing and invalid values are the defaults", () => {
  const defaults = { step: 0, speed: null, agent: null, compared: "none" };
  for (const query of [undefined, "", "step=-1&speed=x&agent=1.5&beside=all", `step=${"9".repeat(30)}`])
    expect(parseReplayQuery(query)).toEqual(defaults);
  expect(queryOfOtherEpisode(parseReplayQuery("step=4"))).toBe("");
});
