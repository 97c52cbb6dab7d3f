/** Starts real servers with a real database, each in a folder of its own, for the tests in a browser. */
import { spawn, type ChildProcess } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

export const ROOT = fileURLToPath(new URL("../..", import.meta.url));
export const BINARY = resolve(process.env["SPARRING_BINARY"] ?? join(ROOT, "target/debug/sparring"));
const START_TIMEOUT_MS = 120_000;

export class SparringServer {
  url = "";
  #process: ChildProcess | undefined;

  private constructor(
    readonly folder: string,
    private readonly flags: string[],
    private readonly environment: Record<string, string>,
  ) {}

  /** Starts a server with a new database at a free port of 127.0.0.1, or at another address. */
  static async start(
    flags: string[] = [],
    environment: Record<string, string> = {},
    bind = "127.0.0.1:0",
  ): Promise<SparringServer> {
    const folder = await mkdtemp(join(tmpdir(), "sparring-browser-"));
    const server = new SparringServer(folder, flags, environment);
    await server.#serve(bind);
    return server;
  }

  get databasePath(): string {
    return join(this.folder, "sparring.sqlite3");
  }

  /** Starts the killed server again at its former address. */
  async restart() {
    await this.#serve(new URL(this.url).host);
  }

  /** Kills the server with SIGKILL, like a power failure. */
  async kill() {
    const process = this.#process;
    if (!process || process.exitCode !== null || process.signalCode !== null) return;
    const exit = new Promise((resolve) => process.once("exit", resolve));
    process.kill("SIGKILL");
    await exit;
  }

  /** Kills the server and deletes its folder. */
  async dispose() {
    await this.kill();
    await rm(this.folder, { recursive: true, force: true });
  }

  /** Runs a subcommand of the binary and returns its stdout. */
  runCommand(...args: string[]): Promise<string> {
    return new Promise((resolve, reject) => {
      const child = spawn(BINARY, args, { stdio: ["ignore", "pipe", "pipe"] });
      let [stdout, stderr] = ["", ""];
      child.stdout.on("data", (text: Buffer) => (stdout += text.toString()));
      child.stderr.on("data", (text: Buffer) => (stderr += text.toString()));
      child.once("error", reject);
      child.once("exit", (code) =>
        code === 0
          ? resolve(stdout)
          : reject(new Error(`sparring ${args.join(" ")}: ${String(code)} ${stderr}`)),
      );
    });
  }

  async #serve(bind: string) {
    const child = spawn(BINARY, ["serve", "--bind", bind, "--db", this.databasePath, ...this.flags], {
      stdio: ["ignore", "pipe", "pipe"],
      env: { ...process.env, ...this.environment },
    });
    this.#process = child;
    this.url = await new Promise((resolve, reject) => {
      let output = "";
      const timeout = setTimeout(
        () => reject(new Error(`the server did not start: ${output}`)),
        START_TIMEOUT_MS,
      );
      const read = (text: Buffer) => {
        output += text.toString();
        const url = /Sparring serves at (http:\/\/\S+)/.exec(output)?.[1];
        if (!url) return;
        clearTimeout(timeout);
        resolve(url);
      };
      child.stdout.on("data", read);
      child.stderr.on("data", read);
      child.once("exit", (code) =>
        reject(new Error(`the server exited with status ${String(code)}: ${output}`)),
      );
    });
    child.removeAllListeners("exit");
  }

  async get<T = Record<string, unknown>>(path: string, token?: string): Promise<T> {
    return this.#request<T>("GET", path, undefined, token);
  }

  async post<T = Record<string, unknown>>(path: string, body: unknown, token?: string): Promise<T> {
    return this.#request<T>("POST", path, body, token);
  }

  async put<T = Record<string, unknown>>(path: string, body: unknown): Promise<T> {
    return this.#request<T>("PUT", path, body);
  }

  async #request<T>(method: string, path: string, body?: unknown, token?: string): Promise<T> {
    const response = await fetch(this.url + path, {
      method,
      headers: { "content-type": "application/json", ...(token ? { authorization: `Bearer ${token}` } : {}) },
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
    });
    if (!response.ok)
      throw new Error(`${method} ${path}: ${String(response.status)} ${await response.text()}`);
    return (await response.json()) as T;
  }
}

export interface Lease {
  lease: string;
  groups: { scenario: { task: string; params: Record<string, number> }; episodes: string[] }[];
}

/**
 * Leases `groups` groups and reports that their agents held in every step: the log has no steps. Returns the ids of
 * the episodes in the order of the lease. `resultFields` is added to each result.
 */
export async function reportHeldEpisodes(
  server: SparringServer,
  run: string,
  groups: number,
  resultFields: object = {},
): Promise<string[]> {
  const lease = await server.post<Lease>(`/v1/runs/${run}/leases`, { groups });
  const episodes = lease.groups.flatMap((group) => group.episodes);
  const results = episodes.map((episode) => ({
    episode,
    actions: { steps: [], stopped: "too_late" },
    ...resultFields,
  }));
  await server.post(`/v1/runs/${run}/results`, { results });
  return episodes;
}
