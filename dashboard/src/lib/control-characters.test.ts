import { expect, test } from "vitest";
import { escapeControlCharacters } from "./control-characters";

test("control characters become visible, line breaks and other scripts stay", () => {
  expect(
    escapeControlCharacters({ name: "a\u202Eb\u2069\u0007", "k\u202A": [1, null], deep: [["\u0085"]] }),
  ).toEqual({
    name: "a⟨U+202E⟩b⟨U+2069⟩⟨U+0007⟩",
    "k⟨U+202A⟩": [1, null],
    deep: [["⟨U+0085⟩"]],
  });
  expect(escapeControlCharacters("שלום\n\tمرحبا")).toBe("שלום\n\tمرحبا");
});
