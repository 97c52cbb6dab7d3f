import { readFileSync } from "node:fs";
import { describe, expect, test } from "vitest";
import type { Strategy, Task } from "./api-types";
import {
  buildRequest,
  curlCommand,
  defaultOf,
  fieldId,
  fieldOfProblem,
  formSections,
  pythonProgram,
  strategyFields,
  taskFields,
  type ApiDocument,
} from "./settings-form";

const SNAPSHOT = new URL(
  "../../../tests/tests/system/snapshots/system__documents__openapi.snap",
  import.meta.url,
);
const text = readFileSync(SNAPSHOT, "utf8");
const openapi = JSON.parse(text.slice(text.indexOf("\n---\n") + 5)) as ApiDocument;
const sections = formSections(openapi);
const fields = sections.flatMap((section) => section.fields);
const byId = (id: string) => fields.find((field) => fieldId(field.path) === id);

describe("form of the settings", () => {
  test("has every field of the request, with explanation, bounds and default", () => {
    const properties = Object.keys(openapi.components.schemas["RunRequest"]?.properties ?? {});
    const shown = new Set(fields.map((field) => field.path[0]));
    const special = ["strategy", "strategy_settings", "task_settings", "tasks"];
    expect(properties.filter((name) => !shown.has(name))).toEqual(special);
    expect(fields.filter((field) => field.description === "")).toEqual([]);
    expect(byId("group_size")).toMatchObject({ kind: "integer", min: 1, max: 1024, default: "1" });
    expect(byId("design.share")).toMatchObject({ kind: "number", min: 0, max: 1, default: "0.3" });
    expect(byId("evidence_from")).toMatchObject({
      kind: "choice",
      choices: ["train", "probe"],
      default: "train",
    });
    expect(byId("placement")?.kind).toBe("boolean");
    expect(byId("tags")?.kind).toBe("list");
    expect(byId("note")?.kind).toBe("long text");
    expect(byId("retention.episodes")).toMatchObject({ kind: "text", default: "50 000" });
  });
  test("has the settings of strategies and tasks that the server lists", () => {
    const strategy = {
      name: "plr",
      settings: [
        { name: "replay", description: "Share", accepts: "a number", default: 0.5, source: "paper" },
      ],
    } as unknown as Strategy;
    expect(strategyFields(strategy)).toMatchObject([
      { path: ["strategy_settings", "replay"], kind: "number", default: "0.5" },
    ]);
    const task = {
      id: "kessler/survival",
      physics: [
        {
          name: "contact",
          choices: ["point", "swept", "none"],
          default: "swept",
          description: "Contacts",
          manual_choices: [{ choice: "none", reason: "x" }],
        },
      ],
    } as unknown as Task;
    const ids = taskFields(openapi, task).map((field) => fieldId(field.path));
    expect(ids).toEqual([
      "task_settings.kessler/survival.success_threshold",
      "task_settings.kessler/survival.weight",
      "task_settings.kessler/survival.physics.contact",
    ]);
    expect(taskFields(openapi, task).at(-1)?.choices).toEqual(["point", "swept"]);
  });
  test("a default is read from its description", () => {
    expect([defaultOf("x (default `auto`)."), defaultOf("x (default: generated)"), defaultOf("x")]).toEqual([
      "auto",
      "generated",
      "",
    ]);
  });
});

describe("request of the form", () => {
  const values = {
    id: "7",
    "design.share": "0.1",
    group_size: "8",
    placement: "false",
    tags: "a, lr:3e-4",
    "retention.episodes": "all",
    min_group: " ",
    contested_share: "half",
  };
  const request = buildRequest(fields, values, "plr", ["kessler/survival"]);
  test("has the fields that are filled, and leaves checks to the server", () => {
    expect(request).toEqual({
      strategy: "plr",
      tasks: ["kessler/survival"],
      id: "7",
      tags: ["a", "lr:3e-4"],
      placement: false,
      contested_share: "half",
      group_size: 8,
      design: { share: 0.1 },
      retention: { episodes: "all" },
    });
  });
  test("is shown as commands", () => {
    const command = curlCommand("http://a:1", { name: "it's" }, true);
    expect(command).toBe(
      `curl http://a:1/v1/runs \\\n  -H "Authorization: Bearer $SPARRING_TOKEN" \\\n  -H 'Content-Type: application/json' \\\n  -d '{\n  "name": "it'\\''s"\n}'`,
    );
    expect(pythonProgram("http://a:1", { placement: false, design: { share: 0.1 }, tags: ["a"] })).toBe(
      `import sparring\n\ncurriculum = sparring.Curriculum(\n    url="http://a:1",\n    settings={\n        "placement": False,\n        "design": {\n            "share": 0.1,\n        },\n        "tags": ["a"],\n    },\n)`,
    );
    expect(pythonProgram("http://a:1", {})).toContain("settings={}");
  });
  test("a problem belongs to the field that it names, or to the list", () => {
    const ids = ["tags", "design.share", "tasks", "task_settings.a/b.weight"];
    expect(
      ["tags.1", "design.share", "task_settings.a/b.weight", "tag", undefined].map((named) =>
        fieldOfProblem(ids, named),
      ),
    ).toEqual(["tags", "design.share", "task_settings.a/b.weight", undefined, undefined]);
  });
});
