/** Checks every page in both colour schemes: it loads, has no errors, and is accessible. */
import { describe, inject, test } from "vitest";
import { checkPages, createEmptyRun, PAGES_OF_EMPTY_RUN, pagesOfTrainedRun } from "./page-checks";
import { useFixture } from "./fixture";

const [url, run] = [inject("url"), inject("run")];
const fixture = useFixture(createEmptyRun);

describe.each([
  { scheme: "light", dark: false },
  { scheme: "dark", dark: true },
])("in the $scheme colour scheme", ({ dark }) => {
  test("every page of a trained run passes the checks", async () => {
    await checkPages(fixture.browser, url, await pagesOfTrainedRun(url, run), dark);
  });

  test("every page of an empty run passes the checks", async () => {
    await checkPages(fixture.browser, fixture.server.url, PAGES_OF_EMPTY_RUN, dark, "empty-");
  });
});
