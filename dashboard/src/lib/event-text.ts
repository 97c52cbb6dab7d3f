/** Texts for the events of a run, one line each. */
import { countOf, shortTask } from "./format";
import type { RunEvent } from "./event-stream.svelte";

function text(value: unknown): string {
  return typeof value === "string"
    ? value
    : value === undefined || value === null
      ? ""
      : JSON.stringify(value);
}

/** Texts for kinds of events without data. */
const KINDS: Record<string, string> = {
  run: "run changed",
  lease: "lease changed",
  group: "group finished",
  move: "level moved",
  claim: "columns reported",
  failures: "failure analysis finished",
  design: "layouts designed",
  worker: "worker joined or left",
  warning: "warning",
  gap: "events missing",
};

/** Describes an event by its kind only. */
export function eventKindText(kind: string): string {
  return KINDS[kind] ?? kind.replaceAll("_", " ");
}

/** Describes an event with its data. */
export function eventText({ kind, data }: RunEvent): string {
  const task = typeof data["task"] === "string" ? shortTask(data["task"]) : "";
  switch (kind) {
    case "run":
      return `run ${text(data["state"])}`;
    case "lease":
      return `lease ${text(data["lease"])} ${text(data["state"])}: ${countOf(Number(data["groups"]), "group")} of ${text(data["group_size"])}, purpose ${text(data["purpose"])}`;
    case "group": {
      const level =
        data["level"] === null || data["level"] === undefined ? "" : ` at level ${text(data["level"])}`;
      return `${task}${level}: ${text(data["successes"])} of ${text(data["finished"])} succeeded (${text(data["state"])})`;
    }
    case "move": {
      const evidence = data["evidence"] as { sentence?: string } | undefined;
      return `${task}: ${text(data["kind"])} to level ${text(data["to"])}. ${evidence?.sentence ?? ""}`;
    }
    case "claim":
      return `${countOf(Number(data["episodes"]), "episode")} in columns: ${text(data["state"])} ${text(data["reason"])}`;
    case "failures":
      return `${task}: failure analysis of ${countOf(Number(data["criticised"]), "episode")} finished`;
    case "design":
      return `${task}: ${text(data["designer"])} designed; ${text(data["admitted"])} admitted, ${text(data["refused"])} refused ${text(data["error"])}`;
    case "worker":
    case "warning":
    case "gap":
      return `${task ? `${task}: ` : ""}${text(data["message"])}`;
    default:
      return text(data);
  }
}
