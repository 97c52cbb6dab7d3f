/** The view of a replay in addresses: step, speed, agent and comparison. */

/** Plan that is shown beside the episode. */
export type ComparedPlan = "none" | "hold" | "reference";

/** State of a replay that its address has. */
export interface ReplayView {
  step: number;
  /** Steps per second, or seconds per second in worlds whose steps differ in duration; null for the default. */
  speed: number | null;
  /** Agent that the page emphasises; null for all. */
  agent: number | null;
  compared: ComparedPlan;
}

/** Reads the view from the query of an address; what is missing or invalid is the default. */
export function parseReplayQuery(query: string | undefined): ReplayView {
  const params = new URLSearchParams(query);
  const whole = (name: string) => {
    const text = params.get(name) ?? "";
    return /^\d{1,9}$/.test(text) ? Number(text) : null;
  };
  const compared = params.get("beside");
  return {
    step: whole("step") ?? 0,
    speed: whole("speed"),
    agent: whole("agent"),
    compared: compared === "hold" || compared === "reference" ? compared : "none",
  };
}

/** Returns the view as the query of an address. */
export function replayQuery({ step, speed, agent, compared }: ReplayView): string {
  return new URLSearchParams({
    step: String(step),
    ...(speed === null ? {} : { speed: String(speed) }),
    ...(agent === null ? {} : { agent: String(agent) }),
    ...(compared === "none" ? {} : { beside: compared }),
  }).toString();
}

/** Returns the query of a link to another episode: the view without its step; empty for the defaults. */
export function queryOfOtherEpisode(view: ReplayView): string {
  const params = new URLSearchParams(replayQuery(view));
  params.delete("step");
  return params.size > 0 ? `?${params.toString()}` : "";
}
