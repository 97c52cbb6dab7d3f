/**
 * What others wrote, as it can be read: characters that nobody sees, but that turn the order of others around or steer a terminal, are
 * shown by their number. Everything that the service tells passes here, so that no page has to think of it.
 */
// eslint-disable-next-line no-control-regex -- those are the ones that are looked for
const UNSEEN = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\u007f-\u009f\u202a-\u202e\u2066-\u2069]/g;

function text(words: string): string {
  return words.replace(
    UNSEEN,
    (one) => `⟨U+${one.charCodeAt(0).toString(16).toUpperCase().padStart(4, "0")}⟩`,
  );
}

/** The same value with every string of it, names of fields too, made readable. */
export function readable<T>(value: T): T {
  return read(value) as T;
}

function read(value: unknown): unknown {
  if (typeof value === "string") return text(value);
  if (value === null || typeof value !== "object") return value;
  if (Array.isArray(value)) return value.map(read);
  return Object.fromEntries(Object.entries(value).map(([name, inner]) => [text(name), read(inner)]));
}
