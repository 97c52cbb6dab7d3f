/** Client of the service's API, typed by its OpenAPI document. Requests carry the token of the session. */
import createClient, { type Middleware } from "openapi-fetch";
import { escapeControlCharacters } from "./control-characters";
import { session } from "./session.svelte";
import type { paths } from "./schema";

/** Failed request: status (0 without a response), message, and the invalid field if the service names one. */
export class ApiError extends Error {
  readonly status: number;
  readonly field: string | undefined;

  constructor(status: number, detail: string, field?: string) {
    super(detail);
    this.status = status;
    this.field = field;
  }
}

/** Time after which the role of the token is read again, if the service was overloaded or unreachable. */
const ROLE_RETRY_MS = 2_000;

/** Returns the token that a request carries. */
function tokenOf(request: Request): string | null {
  return request.headers.get("Authorization")?.replace("Bearer ", "") ?? null;
}

const authorizeRequests: Middleware = {
  onRequest({ request }) {
    if (session.token) request.headers.set("Authorization", `Bearer ${session.token}`);
    return request;
  },
  onResponse({ request, response }) {
    if (response.status === 401) session.reject(tokenOf(request));
  },
};

export const client = createClient<paths>({ baseUrl: "" });
client.use(authorizeRequests);

interface ApiResult<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

/** Returns the body of a successful response; throws an ApiError for any other. */
export async function unwrap<T>(request: Promise<ApiResult<T>>): Promise<T> {
  let result: ApiResult<T>;
  try {
    result = await request;
  } catch {
    throw new ApiError(0, "The server does not respond. Check that `sparring serve` runs at this address.");
  }
  if (result.response.ok && result.data !== undefined) return escapeControlCharacters(result.data);
  const problem = escapeControlCharacters(result.error ?? {}) as { detail?: string; field?: string };
  if (result.response.status === 403) session.readRole(problem.detail ?? "");
  throw new ApiError(
    result.response.status,
    problem.detail ?? `The server responded with status ${String(result.response.status)}.`,
    problem.field,
  );
}

/**
 * Detects the role of the token: only admins may read the audit log, and a 403 response names the actual role. Requests that an overloaded
 * or unreachable service does not answer are repeated.
 */
export async function detectRole() {
  const token = session.token;
  while (session.token === token && session.role === null && !session.loginRequired) {
    try {
      await unwrap(client.GET("/v1/audit", { params: { query: { limit: 1 } } }));
      if (session.token === token) session.role = "admin";
      return;
    } catch (error) {
      // A 403 response has set the role. The current page reports any other error.
      const status = error instanceof ApiError ? error.status : 0;
      if (status >= 400 && status < 500 && status !== 429) return;
    }
    await new Promise((resolve) => setTimeout(resolve, ROLE_RETRY_MS));
  }
}

/** Loads the OpenAPI document of the service. */
export async function loadApiDocument(): Promise<unknown> {
  const headers = new Headers();
  if (session.token) headers.set("Authorization", `Bearer ${session.token}`);
  const response = await fetch("/openapi.json", { headers });
  if (!response.ok)
    throw new ApiError(response.status, `The server responded with status ${String(response.status)}.`);
  return response.json();
}
