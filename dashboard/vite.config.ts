import { readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { promisify } from "node:util";
import { brotliCompress, constants, gzip } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin } from "vite";

const brotli = promisify(brotliCompress);
const zip = promisify(gzip);

/** Each file once more as .br and .gz: the service sends them as they are. */
function compressed(): Plugin {
  return {
    name: "compressed",
    apply: "build",
    enforce: "post",
    // What was written, not the bundle in hand: Vite itself changes that once more.
    async writeBundle(options, bundle) {
      for (const name of Object.keys(bundle)) {
        const file = join(options.dir ?? "dist", name);
        const source = await readFile(file);
        if (source.length < 512) continue;
        const best = { params: { [constants.BROTLI_PARAM_QUALITY]: constants.BROTLI_MAX_QUALITY } };
        await writeFile(`${file}.br`, await brotli(source, best));
        await writeFile(`${file}.gz`, await zip(source, { level: 9 }));
      }
    },
  };
}

export default defineConfig({
  base: "/dashboard/",
  plugins: [svelte(), compressed()],
  build: { target: "es2022", assetsInlineLimit: 0, sourcemap: false },
  server: {
    proxy: {
      "^/(v1|health|livez|readyz|metrics|ws|openapi.json)": process.env.SPARRING ?? "http://127.0.0.1:8700",
    },
  },
  test: { include: ["src/**/*.test.ts"] },
} as import("vite").UserConfig & { test: object });
