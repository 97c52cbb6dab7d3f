import { expect, test } from "vitest";
import { describeMessage } from "./alert-text";

test("the state of a message says what the webhook knows", () => {
  const describe = (
    message_state: "none" | "waiting" | "sent" | "given_up",
    message_error: string | null = null,
  ) => describeMessage({ message_state, message_error });
  expect([describe("none"), describe("waiting"), describe("sent")]).toEqual([
    "no webhook",
    "waiting",
    "sent",
  ]);
  expect(describe("waiting", "refused")).toBe("tried: refused");
  expect(describe("given_up", "refused")).toBe("given up: refused");
});
