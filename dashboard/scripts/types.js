// Generates src/lib/schema.d.ts, the types of the API, from the OpenAPI snapshot of the system tests.
import { readFile, writeFile } from "node:fs/promises";
import openapiTS, { astToString } from "openapi-typescript";

const SNAPSHOT = new URL(
  "../../tests/tests/system/snapshots/system__documents__openapi.snap",
  import.meta.url,
);
const OUTPUT = new URL("../src/lib/schema.d.ts", import.meta.url);

const snapshot = await readFile(SNAPSHOT, "utf8");
const document = JSON.parse(snapshot.slice(snapshot.indexOf("\n---\n") + 5)); // skips the header of insta
await writeFile(OUTPUT, astToString(await openapiTS(document, { emptyObjectsUnknown: true })));
