/** The tests of all pages in one colour scheme: a page loads, has no errors, and is accessible. */
import { inject, test } from "vitest";
import { checkPages, createEmptyRun, PAGES_OF_EMPTY_RUN, pagesOfTrainedRun } from "./page-checks";
import { useFixture } from "./fixture";

/** Defines the tests. Each colour scheme has a file of its own, so that both run at the same time. */
export function testAllPages(dark: boolean) {
  const [url, run] = [inject("url"), inject("run")];
  const fixture = useFixture(createEmptyRun);

  test("every page of a trained run passes the checks", async () => {
    await checkPages(fixture.browser, url, await pagesOfTrainedRun(url, run), dark);
  });

  test("every page of an empty run passes the checks", async () => {
    await checkPages(fixture.browser, fixture.server.url, PAGES_OF_EMPTY_RUN, dark, "empty-");
  });
}
