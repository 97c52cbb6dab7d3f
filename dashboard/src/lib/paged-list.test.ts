import { expect, test } from "vitest";
import { PagedList, type Page, type PageQuery } from "./paged-list.svelte";

/** Pages of the numbers 1 to 5, two on a page. */
function fetchNumbers({ cursor = "0" }: PageQuery): Promise<Page<number>> {
  const start = Number(cursor);
  const items = [1, 2, 3, 4, 5].slice(start, start + 2);
  return Promise.resolve({ items, next: start + 2 < 5 ? String(start + 2) : null });
}

test("pages are appended until the last one", async () => {
  const list = new PagedList(fetchNumbers);
  expect(list.isLoaded).toBe(false);
  await list.reload();
  expect([list.items, list.next, list.isLoaded]).toEqual([[1, 2], "2", true]);
  await list.loadMore();
  await list.loadMore();
  expect([list.items, list.next]).toEqual([[1, 2, 3, 4, 5], null]);
  await list.loadMore();
  expect(list.items).toEqual([1, 2, 3, 4, 5]);
});

test("a refresh keeps further pages; a reload drops them", async () => {
  let requests = 0;
  const list = new PagedList((query) => {
    requests += 1;
    return fetchNumbers(query);
  });
  await list.refresh();
  await list.refresh();
  expect(requests).toBe(2);
  await Promise.all([list.loadMore(), list.refresh()]); // the refresh does not replace the request
  await list.refresh();
  expect([requests, list.items]).toEqual([3, [1, 2, 3, 4]]);
  await list.reload();
  expect([requests, list.items]).toEqual([4, [1, 2]]);
});

test("the response to an earlier request is dropped", async () => {
  const responses: ((page: Page<string>) => void)[] = [];
  const list = new PagedList<string>(() => new Promise((resolve) => responses.push(resolve)));
  const loads = [list.reload(), list.reload()];
  responses[1]?.({ items: ["later"] });
  responses[0]?.({ items: ["earlier"] });
  await Promise.all(loads);
  expect(list.items).toEqual(["later"]);
});

test("an error keeps the items until the next success", async () => {
  let fails = false;
  const list = new PagedList((query) => (fails ? Promise.reject(new Error("busy")) : fetchNumbers(query)));
  await list.reload();
  fails = true;
  await list.reload();
  expect([list.items, (list.error as Error).message]).toEqual([[1, 2], "busy"]);
  fails = false;
  await list.reload();
  expect(list.error).toBeNull();
});
