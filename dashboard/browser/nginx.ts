/** Starts nginx with the configuration that operators copy, in front of two servers. */
import { spawn, type ChildProcess } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { waitFor } from "./poll";
import { freePort } from "./ports";
import { ROOT } from "./server";

/** Path of the program: that of `NGINX`, or the one of Debian's package, which `scripts/nginx` installs. */
const PROGRAM = process.env["NGINX"] ?? "/usr/sbin/nginx";

export class Nginx {
  #process: ChildProcess | undefined;

  private constructor(
    readonly url: string,
    private readonly folder: string,
  ) {}

  /** Starts nginx on a free port; `east` and `west` are the hosts and ports of the servers of these shards. */
  static async start(east: string, west: string): Promise<Nginx> {
    const folder = await mkdtemp(join(tmpdir(), "sparring-nginx-"));
    const address = `127.0.0.1:${String(await freePort())}`;
    const configuration = (await readFile(join(ROOT, "deploy/nginx.conf"), "utf8"))
      .replaceAll("10.0.0.5:8700", east)
      .replaceAll("10.0.0.6:8700", west)
      .replace("listen 80;", `listen ${address};`);
    const names = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"];
    const paths = names.map((name) => `${name}_temp_path ${folder}/${name};`).join(" ");
    const file = join(folder, "nginx.conf");
    await writeFile(
      file,
      `daemon off; master_process off; pid ${folder}/pid; events {} http { access_log off; ${paths}\n${configuration}}`,
    );
    const nginx = new Nginx(`http://${address}`, folder);
    nginx.#process = spawn(PROGRAM, ["-p", folder, "-c", file, "-e", "stderr"], { stdio: "ignore" });
    const isReady = () =>
      fetch(`${nginx.url}/livez`).then(
        ({ ok }) => ok,
        () => false,
      );
    await waitFor(isReady, (ready) => ready);
    return nginx;
  }

  /** Ends nginx and deletes its folder. */
  async dispose() {
    const process = this.#process;
    if (process && process.exitCode === null && process.signalCode === null) {
      const exit = new Promise((resolve) => process.once("exit", resolve));
      process.kill("SIGKILL");
      await exit;
    }
    await rm(this.folder, { recursive: true, force: true });
  }
}
