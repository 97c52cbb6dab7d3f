/** Starts real NATS servers and workers for the tests of the page of workers. */
import { spawn, type ChildProcess } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdtemp, rm } from "node:fs/promises";
import { connect } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { waitFor } from "./poll";
import { freePort } from "./ports";
import { BINARY, ROOT } from "./server";

/** Path of the program: that of `NATS_SERVER`, or the one that `scripts/nats` installed; null where the package index has none. */
export function natsProgram(): string | null {
  const chosen = process.env["NATS_SERVER"];
  if (chosen) return chosen;
  const program = join(ROOT, "target/nats/nats-server");
  if (existsSync(program)) return program;
  if (existsSync(join(ROOT, "target/nats/unavailable"))) return null;
  throw new Error("nats-server is missing: run scripts/nats, or set NATS_SERVER");
}

/** Kills a process with SIGKILL, and waits until it has ended. */
async function kill(child: ChildProcess | undefined) {
  if (!child || child.exitCode !== null || child.signalCode !== null) return;
  const exit = new Promise((resolve) => child.once("exit", resolve));
  child.kill("SIGKILL");
  await exit;
}

function listens(port: number): Promise<boolean> {
  return new Promise((resolve) => {
    const socket = connect(port, "127.0.0.1");
    socket.once("connect", () => {
      socket.destroy();
      resolve(true);
    });
    socket.once("error", () => resolve(false));
  });
}

/** NATS server with JetStream in a folder of its own. */
export class NatsServer {
  #process: ChildProcess | undefined;

  private constructor(
    private readonly program: string,
    private readonly folder: string,
    private readonly port: number,
  ) {}

  static async start(program: string): Promise<NatsServer> {
    const folder = await mkdtemp(join(tmpdir(), "sparring-nats-"));
    const server = new NatsServer(program, folder, await freePort());
    await server.resume();
    return server;
  }

  get url(): string {
    return `nats://127.0.0.1:${String(this.port)}`;
  }

  /** Starts the killed server again, with its port and folder. */
  async resume() {
    const flags = ["-js", "-a", "127.0.0.1", "-p", String(this.port), "-sd", this.folder];
    this.#process = spawn(this.program, flags, { stdio: "ignore" });
    await waitFor(
      () => listens(this.port),
      (isReady) => isReady,
    );
  }

  async kill() {
    await kill(this.#process);
  }

  /** Kills the server and deletes its folder. */
  async dispose() {
    await this.kill();
    await rm(this.folder, { recursive: true, force: true });
  }
}

/** A `sparring worker`. */
export class WorkerProcess {
  readonly #process: ChildProcess;

  constructor(nats: NatsServer, host: string) {
    const flags = ["worker", "--nats", nats.url, "--concurrency", "1", "--host", host];
    this.#process = spawn(BINARY, flags, { stdio: "ignore" });
  }

  /** Stops the process without ending it: the worker sends no heartbeats. */
  pause() {
    this.#process.kill("SIGSTOP");
  }

  async kill() {
    await kill(this.#process);
  }
}
