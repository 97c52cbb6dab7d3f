import { expect, test } from "vitest";
import { designStateText, refusalText } from "./design-text";

test("a refusal names the defect instead of the check", () => {
  expect(designStateText("refused", "new")).toBe("refused: duplicate");
  expect(designStateText("refused", "contested")).toBe("refused: not contested");
  expect(refusalText("later_check")).toBe("failed the check later check");
});

test("other states have their reason", () => {
  expect(designStateText("active", null)).toBe("active");
  expect(designStateText("retired", "mastered")).toBe("retired: mastered");
  expect(designStateText("retired", "user")).toBe("retired: by a user");
  expect(designStateText("retired", "wrong")).toBe("retired: judged wrongly by a worker");
});
