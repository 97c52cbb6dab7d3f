// The types of the API, from its OpenAPI document as the service's own tests hold it: src/lib/schema.d.ts.
import { readFile, writeFile } from "node:fs/promises";
import openapiTS, { astToString } from "openapi-typescript";

const SNAPSHOT = new URL(
  "../../tests/tests/system/snapshots/system__documents__openapi.snap",
  import.meta.url,
);
const OUT = new URL("../src/lib/schema.d.ts", import.meta.url);

const snapshot = await readFile(SNAPSHOT, "utf8");
const document = JSON.parse(snapshot.slice(snapshot.indexOf("\n---\n") + 5)); // behind insta's own head
await writeFile(OUT, astToString(await openapiTS(document, { emptyObjectsUnknown: true })));
