import { readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { promisify } from "node:util";
import { brotliCompress, constants, gzip } from "node:zlib";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig, type Plugin } from "vite";

const brotliAsync = promisify(brotliCompress);
const gzipAsync = promisify(gzip);

/** Compresses each file to .br and .gz, which the server sends unchanged. */
function compressFiles(): Plugin {
  return {
    name: "compress-files",
    apply: "build",
    enforce: "post",
    // Reads the written files, not the bundle object: Vite changes the files once more.
    async writeBundle(options, bundle) {
      for (const name of Object.keys(bundle)) {
        const file = join(options.dir ?? "dist", name);
        const source = await readFile(file);
        if (source.length < 512) continue;
        const bestQuality = { params: { [constants.BROTLI_PARAM_QUALITY]: constants.BROTLI_MAX_QUALITY } };
        await writeFile(`${file}.br`, await brotliAsync(source, bestQuality));
        await writeFile(`${file}.gz`, await gzipAsync(source, { level: 9 }));
      }
    },
  };
}

export default defineConfig({
  base: "/dashboard/",
  plugins: [svelte(), compressFiles()],
  build: { target: "es2022", assetsInlineLimit: 0, sourcemap: false },
  server: {
    proxy: {
      "^/(v1|health|livez|readyz|metrics|ws|openapi.json)": process.env.SPARRING ?? "http://127.0.0.1:8700",
    },
  },
  test: { include: ["src/**/*.test.ts"] },
} as import("vite").UserConfig & { test: object });
