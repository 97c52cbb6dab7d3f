import { describe, expect, test } from "vitest";
import {
  MAX_COMPARED,
  comparisonAddress,
  filtersOf,
  groupFilter,
  groupName,
  parseView,
  sortBy,
  tableColumns,
  viewAddress,
} from "./run-query";

describe("view of the runs in the address", () => {
  test("an empty query is the default view, and is written as one", () => {
    const view = parseView("");
    expect([view.sort, view.descending, view.group, view.search]).toEqual(["created", true, "", ""]);
    expect(view.columns).toContain("skill");
    expect(view.columns.slice(view.columns.indexOf("levels"))[1]).toBe("skill");
    expect(viewAddress(view)).toBe("#/");
    expect(filtersOf(view)).toEqual({});
  });
  test("every part survives", () => {
    const query =
      "search=lr+3e-4&activity=idle&tag=paper&strategy=plr&group=tasks&sort=skill&order=asc&selected=a,b&dialog=delete&columns=note,seed";
    expect(viewAddress(parseView(query))).toBe(`#/?${query}`);
    for (const part of ["dialog=new", "dialog=edit%3Amine", "columns="])
      expect(viewAddress(parseView(part))).toBe(`#/?${part}`);
  });
  test("a deletion needs selected runs, and a long selection is not in the address", () => {
    expect(parseView("dialog=delete").dialog).toBe("");
    expect(parseView("dialog=other").dialog).toBe("");
    const selected = Array.from({ length: MAX_COMPARED + 1 }, (_, i) => `run-${String(i)}`);
    expect(viewAddress({ ...parseView(""), selected, dialog: "delete" })).toBe("#/");
  });
  test("unknown words are left out, and columns keep their order", () => {
    const view = parseView("sort=x&group=y&activity=z&columns=tags,nothing,activity");
    expect([view.sort, view.group, view.activity]).toEqual(["created", "", ""]);
    expect(view.columns).toEqual(["activity", "tags"]);
    expect(parseView("columns=").columns).toEqual([]);
  });
  test("a column sorts in its usual direction first", () => {
    const byName = sortBy(parseView(""), "name");
    expect([byName.sort, byName.descending]).toEqual(["name", false]);
    expect(sortBy(byName, "name").descending).toBe(true);
    expect(sortBy(byName, "skill").descending).toBe(true);
  });
  test("spaces alone are no search, and ids of compared runs are in the address", () => {
    expect(filtersOf(parseView("search=+++"))).toEqual({});
    expect(comparisonAddress(["a", "b-1"])).toBe("#/compare?runs=a,b-1");
  });
  test("groups are filters, and runs without tags are a group", () => {
    expect([groupFilter("", "x"), groupFilter("tasks", "a/b,c/d"), groupFilter("tag", "")]).toEqual([
      {},
      { tasks: "a/b,c/d" },
      { tag: "" },
    ]);
    expect([groupName("tag", ""), groupName("tasks", "a/b,c/d"), groupName("strategy", "plr")]).toEqual([
      "no tags",
      "a/b, c/d",
      "plr",
    ]);
  });
  test("the table is as wide as its columns", () => {
    expect(tableColumns(["strategy", "note"])).toEqual({
      template: "1.2rem minmax(12rem, 5fr) 5.5rem minmax(10rem, 1fr) 7.2rem",
      width: "40rem",
    });
  });
});
