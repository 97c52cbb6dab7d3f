/** A real service with a real database in a folder of its own, for tests in a real browser. */
import { spawn, type ChildProcess } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const ROOT = fileURLToPath(new URL("../..", import.meta.url));
const BINARY = resolve(process.env["SPARRING_BINARY"] ?? join(ROOT, "target/debug/sparring"));
const START_MS = 30_000;

export class Sparring {
  url = "";
  #process: ChildProcess | undefined;

  private constructor(
    readonly folder: string,
    private readonly flags: string[],
    private readonly environment: Record<string, string>,
  ) {}

  static async start(flags: string[] = [], environment: Record<string, string> = {}): Promise<Sparring> {
    const made = new Sparring(await mkdtemp(join(tmpdir(), "sparring-browser-")), flags, environment);
    await made.#serve("127.0.0.1:0");
    return made;
  }

  get db(): string {
    return join(this.folder, "sparring.sqlite3");
  }

  /** Starts the server at its old address. */
  async again() {
    await this.#serve(new URL(this.url).host);
  }

  /** Kills the server, as a machine that loses power does. */
  async kill() {
    const process = this.#process;
    if (!process || process.exitCode !== null) return;
    const gone = new Promise((done) => process.once("exit", done));
    process.kill("SIGKILL");
    await gone;
  }

  async end() {
    await this.kill();
    await rm(this.folder, { recursive: true, force: true });
  }

  /** Runs a subcommand to its end; its stdout. */
  run(...args: string[]): Promise<string> {
    return new Promise((done, fail) => {
      const child = spawn(BINARY, args, { stdio: ["ignore", "pipe", "pipe"] });
      let [out, err] = ["", ""];
      child.stdout.on("data", (text: Buffer) => (out += text.toString()));
      child.stderr.on("data", (text: Buffer) => (err += text.toString()));
      child.once("error", fail);
      child.once("exit", (code) =>
        code === 0 ? done(out) : fail(new Error(`sparring ${args.join(" ")}: ${String(code)} ${err}`)),
      );
    });
  }

  async #serve(bind: string) {
    const child = spawn(BINARY, ["serve", "--bind", bind, "--db", this.db, ...this.flags], {
      stdio: ["ignore", "pipe", "pipe"],
      env: { ...process.env, ...this.environment },
    });
    this.#process = child;
    this.url = await new Promise((done, fail) => {
      let said = "";
      const late = setTimeout(() => fail(new Error(`the server did not start: ${said}`)), START_MS);
      const hear = (text: Buffer) => {
        said += text.toString();
        const url = /Sparring serves at (http:\/\/\S+)/.exec(said)?.[1];
        if (!url) return;
        clearTimeout(late);
        done(url);
      };
      child.stdout.on("data", hear);
      child.stderr.on("data", hear);
      child.once("exit", (code) => fail(new Error(`the server ended with ${String(code)}: ${said}`)));
    });
    child.removeAllListeners("exit");
  }

  async get<T = Record<string, unknown>>(path: string, token?: string): Promise<T> {
    return this.#ask<T>("GET", path, undefined, token);
  }

  async post<T = Record<string, unknown>>(path: string, body: unknown, token?: string): Promise<T> {
    return this.#ask<T>("POST", path, body, token);
  }

  async put<T = Record<string, unknown>>(path: string, body: unknown): Promise<T> {
    return this.#ask<T>("PUT", path, body);
  }

  async #ask<T>(method: string, path: string, body?: unknown, token?: string): Promise<T> {
    const answer = await fetch(this.url + path, {
      method,
      headers: { "content-type": "application/json", ...(token ? { authorization: `Bearer ${token}` } : {}) },
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
    });
    if (!answer.ok) throw new Error(`${method} ${path}: ${String(answer.status)} ${await answer.text()}`);
    return (await answer.json()) as T;
  }
}

export interface Lease {
  lease: string;
  groups: { scenario: { task: string; params: Record<string, number> }; episodes: string[] }[];
}

/** Leases so many groups and reports that nobody acted in them, which a log that stopped at once says: the episodes, in order. */
export async function hold(
  service: Sparring,
  run: string,
  groups: number,
  extra: object = {},
): Promise<string[]> {
  const lease = await service.post<Lease>(`/v1/runs/${run}/leases`, { groups });
  const episodes = lease.groups.flatMap((group) => group.episodes);
  const results = episodes.map((episode) => ({
    episode,
    actions: { steps: [], stopped: "too_late" },
    ...extra,
  }));
  await service.post(`/v1/runs/${run}/results`, { results });
  return episodes;
}
