/**
 * Makes invisible control characters in text from models and trainers visible: those that change the order of text or control a terminal
 * are replaced by their code point. Every response of the service passes through here, so that no page needs to handle them.
 */
// eslint-disable-next-line no-control-regex -- the expression matches control characters
const CONTROL_CHARACTERS = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\u007f-\u009f\u202a-\u202e\u2066-\u2069]/g;

function escapeText(text: string): string {
  return text.replace(
    CONTROL_CHARACTERS,
    (character) => `⟨U+${character.charCodeAt(0).toString(16).toUpperCase().padStart(4, "0")}⟩`,
  );
}

/** Returns a copy of a JSON value in which all strings and field names have their control characters replaced. */
export function escapeControlCharacters<T>(value: T): T {
  return escapeValue(value) as T;
}

function escapeValue(value: unknown): unknown {
  if (typeof value === "string") return escapeText(value);
  if (value === null || typeof value !== "object") return value;
  if (Array.isArray(value)) return value.map(escapeValue);
  return Object.fromEntries(
    Object.entries(value).map(([name, inner]) => [escapeText(name), escapeValue(inner)]),
  );
}
