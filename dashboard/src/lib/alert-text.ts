/** Words for alerts. */
import type { Alert } from "./api-types";

/** Name of each rule. */
export const RULE_NAMES: Record<Alert["rule"], string> = {
  no_results: "No results",
  missing_share: "Missing episodes",
  low_disk: "Disk nearly full",
  level_down: "Level down",
  evaluation_worse: "Evaluation worse",
  worker_lost: "Worker lost",
};

/** Returns what the webhook knows of an alert. */
export function describeMessage(alert: Pick<Alert, "message_state" | "message_error">): string {
  switch (alert.message_state) {
    case "none":
      return "no webhook";
    case "sent":
      return "sent";
    case "given_up":
      return `given up: ${alert.message_error ?? "no answer"}`;
    case "waiting":
      return !alert.message_error ? "waiting" : `tried: ${alert.message_error}`;
  }
}
