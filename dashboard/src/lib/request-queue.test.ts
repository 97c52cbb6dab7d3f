import { expect, test } from "vitest";
import { RequestQueue } from "./request-queue";

/** Queue whose requests end when the test says so. */
function controlled(atOnce: number) {
  const begun: string[] = [];
  const ends = new Map<string, (error?: Error) => void>();
  const queue = new RequestQueue(atOnce, (id) => {
    begun.push(id);
    return new Promise((resolve, reject) => {
      ends.set(id, (error) => (error ? reject(error) : resolve(undefined)));
    });
  });
  const end = async (id: string, error?: Error) => {
    ends.get(id)?.(error);
    await new Promise((resolve) => setTimeout(resolve));
  };
  return { queue, begun, end };
}

test("a few requests are under way at once, in the order of their items", async () => {
  const { queue, begun, end } = controlled(2);
  for (const id of ["a", "b", "c", "d"]) queue.add(id);
  expect(begun).toEqual(["a", "b"]);
  await end("b");
  expect(begun).toEqual(["a", "b", "c"]);
  await end("a", new Error("unreadable"));
  expect(begun).toEqual(["a", "b", "c", "d"]);
});

test("an item that all callers withdraw is not requested", async () => {
  const { queue, begun, end } = controlled(1);
  queue.add("a");
  const [first, second] = [queue.add("b"), queue.add("b")];
  const other = queue.add("c");
  first();
  first(); // has no further effect
  other();
  await end("a");
  expect(begun).toEqual(["a", "b"]);
  second(); // its request has begun
  await end("b");
  expect(begun).toEqual(["a", "b"]);
});

test("an item is not requested again while its request is under way", async () => {
  const { queue, begun, end } = controlled(4);
  queue.add("a");
  queue.add("a")();
  expect(begun).toEqual(["a"]);
  await end("a");
  queue.add("a");
  expect(begun).toEqual(["a", "a"]);
});
