/** The service's API: typed by its OpenAPI document, with the token of whoever is logged in. */
import createClient, { type Middleware } from "openapi-fetch";
import { readable } from "./readable";
import { session } from "./session.svelte";
import type { components, paths } from "./schema";

export type Schema = components["schemas"];

/** What a request came to, where it came to nothing: words for people, and the field at fault. */
export class Refused extends Error {
  readonly status: number;
  readonly field: string | undefined;

  constructor(status: number, detail: string, field?: string) {
    super(detail);
    this.status = status;
    this.field = field;
  }
}

const authorised: Middleware = {
  onRequest({ request }) {
    if (session.token) request.headers.set("Authorization", `Bearer ${session.token}`);
    return request;
  },
  onResponse({ response }) {
    if (response.status === 401) session.needed = true;
  },
};

export const client = createClient<paths>({ baseUrl: "" });
client.use(authorised);

interface Answer<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

/** The body of an answer, or what is wrong thrown. */
export async function body<T>(asked: Promise<Answer<T>>): Promise<T> {
  let answer: Answer<T>;
  try {
    answer = await asked;
  } catch {
    throw new Refused(0, "The service does not answer.");
  }
  if (answer.response.ok && answer.data !== undefined) return readable(answer.data);
  const problem = readable(answer.error ?? {}) as { detail?: string; field?: string };
  if (answer.response.status === 403) session.refused(problem.detail ?? "");
  throw new Refused(
    answer.response.status,
    problem.detail ?? `The service answers ${String(answer.response.status)}.`,
    problem.field,
  );
}

/** Learns what the token is good for: the service tells by what it lets it see, and names its role where it does not. */
export async function learnRole() {
  const token = session.token;
  try {
    await body(client.GET("/v1/audit", { params: { query: { limit: 1 } } }));
    if (session.token === token) session.role = "admin";
  } catch {
    // A refusal has told the role; any other trouble is told by the page that has it.
  }
}
