/** Form of the settings of a run, from what the API publishes: its OpenAPI document, the strategies and the tasks. */
import type { Strategy, Task } from "./api-types";

export type FieldKind = "integer" | "number" | "boolean" | "choice" | "list" | "long text" | "text";

export interface SettingField {
  /** Names from the request to the value, such as design and share. */
  path: readonly string[];
  kind: FieldKind;
  description: string;
  /** Values of a choice. */
  choices: readonly string[];
  min?: number | undefined;
  max?: number | undefined;
  /** Default as text; empty if there is none. */
  default: string;
}

export interface FormSection {
  title: string;
  fields: SettingField[];
}

/** Schema of the OpenAPI document, as far as the form reads it. */
interface Schema {
  type?: string | string[];
  description?: string;
  enum?: unknown[];
  default?: unknown;
  minimum?: number;
  maximum?: number;
  maxLength?: number;
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  $ref?: string;
}

export interface ApiDocument {
  components: { schemas: Record<string, Schema> };
}

/** Choices that the document has as text only. */
const CHOICES: Record<string, readonly string[]> = {
  target: ["mastery", "half"],
  judge: ["off", "deterministic", "llm"],
};
/** Fields by section, in their order; unknown fields come into the last one. */
const SECTIONS: [string, readonly string[]][] = [
  ["Run", ["id", "name", "tags", "note", "seed"]],
  ["Curriculum", ["target", "placement", "contested_share", "frontier_share"]],
  ["Groups and evidence", ["group_size", "min_group", "max_staleness", "evidence_from", "success"]],
  ["Designed layouts", ["design"]],
  ["Server", ["judge", "audit_groups", "retention"]],
];
/** Fields with controls of their own. */
const SPECIAL = new Set(["strategy", "strategy_settings", "tasks", "task_settings"]);
/** Settings of a task that are no single values. */
const TASK_TABLES = new Set(["levels", "physics"]);

function resolve(document: ApiDocument, schema: Schema): Schema {
  const [only, ...others] = (schema.oneOf ?? []).filter((one) => one.type !== "null");
  const inner = only && others.length === 0 ? only : schema;
  const name = inner.$ref?.split("/").pop();
  const target = name === undefined ? undefined : document.components.schemas[name];
  if (!target) return inner;
  const description = inner.description ?? schema.description ?? target.description;
  return { ...resolve(document, target), ...(description === undefined ? {} : { description }) };
}

function kindOf(name: string, schema: Schema): FieldKind {
  const types = [schema.type].flat();
  if (schema.enum) return "choice";
  if (types.includes("boolean")) return "boolean";
  if (types.includes("array")) return "list";
  if (types.includes("integer") && !schema.oneOf) return "integer";
  if (types.includes("number")) return "number";
  return name in CHOICES ? "choice" : (schema.maxLength ?? 0) > 500 ? "long text" : "text";
}

/** Returns the default that a description names, such as 0.5 for "… (default 0.5)". */
export function defaultOf(description: string): string {
  return /\(default:? ([^)]*)\)/.exec(description)?.[1]?.replaceAll("`", "") ?? "";
}

function field(document: ApiDocument, path: readonly string[], schema: Schema): SettingField[] {
  const name = path.at(-1) ?? "";
  const resolved = resolve(document, schema);
  if (resolved.properties)
    return Object.entries(resolved.properties)
      .filter(([inner]) => !TASK_TABLES.has(inner))
      .flatMap(([inner, of]) => field(document, [...path, inner], of));
  const description = resolved.description ?? "";
  return [
    {
      path,
      kind: kindOf(name, resolved),
      description,
      choices: resolved.enum?.map(String) ?? CHOICES[name] ?? [],
      min: resolved.minimum,
      max: resolved.maximum,
      default: defaultOf(description),
    },
  ];
}

/** Returns the sections of the form; controls for strategies and tasks are not part of it. */
export function formSections(document: ApiDocument): FormSection[] {
  const properties = document.components.schemas["RunRequest"]?.properties ?? {};
  const known = SECTIONS.flatMap(([, names]) => names);
  const others = Object.keys(properties).filter((name) => !known.includes(name) && !SPECIAL.has(name));
  const sections: [string, readonly string[]][] = [...SECTIONS, ["Other settings", others]];
  return sections
    .map(([title, names]) => ({
      title,
      fields: names.flatMap((name) => (properties[name] ? field(document, [name], properties[name]) : [])),
    }))
    .filter(({ fields }) => fields.length > 0);
}

/** Returns the fields of the settings of a strategy. */
export function strategyFields(strategy: Strategy | undefined): SettingField[] {
  return (strategy?.settings ?? []).map((setting) => ({
    path: ["strategy_settings", setting.name],
    kind: typeof setting.default === "number" ? "number" : "text",
    description: `${setting.description}: ${setting.accepts}. Source of the default: ${setting.source}`,
    choices: [],
    default: String(setting.default),
  }));
}

/** Returns the fields of the settings of a task. */
export function taskFields(document: ApiDocument, task: Task): SettingField[] {
  const path = ["task_settings", task.id];
  const manual = (name: string) => task.physics.find((option) => option.name === name)?.manual_choices ?? [];
  const physics = task.physics.map((option) => ({
    path: [...path, "physics", option.name],
    kind: "choice" as const,
    description: option.description,
    choices: option.choices.filter((choice) => !manual(option.name).some((one) => one.choice === choice)),
    default: option.default,
  }));
  return [...field(document, path, { $ref: "#/components/schemas/TaskSettingsRequest" }), ...physics];
}

/** Name of a field in the problems of the API, and its id in the form. */
export function fieldId(path: readonly string[]): string {
  return path.join(".");
}

/** Converts the text of a control. A text that is no number is sent as it is: the server then names the field. */
function parseValue(kind: FieldKind, text: string): unknown {
  if (kind === "boolean") return text === "true";
  if (kind === "list") return text.split(/[\s,]+/).filter((item) => item !== "");
  const isNumber = text.trim() !== "" && Number.isFinite(Number(text));
  return (kind === "number" || kind === "integer" || kind === "text") && isNumber ? Number(text) : text;
}

/** Fields whose text is never a number. */
const TEXTS = new Set(["id", "name", "note"]);

/** Returns the request of the form: without the fields that are empty, which have their defaults. */
export function buildRequest(
  fields: readonly SettingField[],
  values: Readonly<Record<string, string>>,
  strategy: string,
  tasks: readonly string[],
): Record<string, unknown> {
  const request: Record<string, unknown> = {
    ...(strategy ? { strategy } : {}),
    ...(tasks.length > 0 ? { tasks: [...tasks] } : {}),
  };
  for (const { path, kind } of fields) {
    const text = values[fieldId(path)] ?? "";
    if (text.trim() === "") continue;
    const isText = path.length === 1 && TEXTS.has(path[0] ?? "");
    let inner = request;
    for (const name of path.slice(0, -1)) inner = (inner[name] ??= {}) as Record<string, unknown>;
    inner[path.at(-1) ?? ""] = isText ? text : parseValue(kind, text);
  }
  return request;
}

/** Returns the id of the field that a problem names; the problem of a list names one of its items. */
export function fieldOfProblem(ids: readonly string[], named: string | undefined): string | undefined {
  if (named === undefined) return undefined;
  const matches = ids.filter((id) => named === id || named.startsWith(`${id}.`));
  return matches.sort((a, b) => b.length - a.length)[0];
}

/** Returns the shell command that creates the run. The token is read from the environment. */
export function curlCommand(origin: string, request: unknown, hasToken: boolean): string {
  const body = JSON.stringify(request, null, 2).replaceAll("'", "'\\''");
  const token = hasToken ? ` \\\n  -H "Authorization: Bearer $SPARRING_TOKEN"` : "";
  return `curl ${origin}/v1/runs${token} \\\n  -H 'Content-Type: application/json' \\\n  -d '${body}'`;
}

/** Formats a JSON value as a Python literal. */
function pythonLiteral(value: unknown, indent: string): string {
  if (value === true) return "True";
  if (value === false) return "False";
  if (Array.isArray(value)) return `[${value.map((item) => pythonLiteral(item, indent)).join(", ")}]`;
  if (value === null || typeof value !== "object") return value === null ? "None" : JSON.stringify(value);
  const inner = `${indent}    `;
  const entries = Object.entries(value).map(
    ([name, item]) => `${inner}${JSON.stringify(name)}: ${pythonLiteral(item, inner)},\n`,
  );
  return entries.length > 0 ? `{\n${entries.join("")}${indent}}` : "{}";
}

/** Returns the Python program that creates the run and trains in it. The package reads the token from the environment. */
export function pythonProgram(origin: string, request: unknown): string {
  const settings = pythonLiteral(request, "    ");
  return `import sparring\n\ncurriculum = sparring.Curriculum(\n    url=${JSON.stringify(origin)},\n    settings=${settings},\n)`;
}
