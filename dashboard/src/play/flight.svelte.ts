/** A scenario flown by hand: what was done, what was seen, and what is meant to be done next. */
import { Refused, body, client, type Schema } from "../lib/api";
import type { AnyFrame, DockingState, KesslerState } from "../replay/frames";

export interface Recipe {
  task: string;
  seed: number;
  params?: Record<string, number>;
}

/** The service's frames, of which a player sees what the agents saw. */
type Told = AnyFrame & { observation: KesslerState | DockingState };

/** LU/TU of burn cost 5 fuel each (kessler's constants, as its task says of `fuel`). */
export const FUEL_PER_SPEED = 5;

/** What agents may do, as a task tells it. */
export interface Space {
  columns: string[];
  low: number;
  high: number;
  unit: string;
}

export function beyond(value: number | undefined, { low, high }: Space): boolean {
  return value !== undefined && (value < low || value > high);
}

/** Working out what a scenario is worth may find the service busy. */
const TRIES = 20;
const PAUSE_MS = 1500;

export class Flight {
  readonly scenario: Record<string, unknown>;
  frames = $state.raw<AnyFrame[]>([]);
  steps = $state.raw<number[][][]>([]);
  done = $state(false);
  horizon = $state(0);
  /** How often a step was taken back. */
  undone = $state(0);
  /** What each agent is to do in the next step. */
  draft = $state<Record<number, number[]>>({});
  worth = $state<Schema["Checked"] | null>(null);
  judged = $state<Schema["Checked"] | null>(null);
  /** Why nobody says what it is worth. */
  unjudged = $state("");
  busy = $state(false);
  trouble = $state<unknown>(null);

  constructor(scenario: Record<string, unknown>) {
    this.scenario = scenario;
    void this.#fly([], 0);
    // What it is worth takes planning: it comes when it comes.
    void this.#weigh();
  }

  get now(): AnyFrame | undefined {
    return this.frames.at(-1);
  }

  /** What is drafted, in the wire's form. */
  get action(): number[][] {
    return Object.entries(this.draft)
      .filter(([, values]) => values.some((value) => value !== 0))
      .map(([agent, values]) => [Number(agent), ...values]);
  }

  /** Does the draft, in so many steps: `again` in each of them, else in the first, and then nobody acts. */
  async commit(times: number, again: boolean) {
    const action = this.action;
    const length = Math.max(1, Math.min(Math.floor(times) || 1, this.horizon - this.steps.length));
    const added = Array.from({ length }, (_, i) => (again || i === 0 ? action : []));
    const before = this.steps.length;
    if (await this.#fly([...this.steps, ...added], before + 1)) this.draft = {};
  }

  undo() {
    if (this.steps.length === 0) return;
    this.steps = this.steps.slice(0, -1);
    this.frames = this.frames.slice(0, -1);
    this.done = false;
    this.judged = null;
    this.undone += 1;
  }

  async #fly(steps: number[][][], from: number): Promise<boolean> {
    if (this.busy) return false;
    this.busy = true;
    try {
      const told = await body(
        client.POST("/v1/flights", { body: { scenario: this.scenario, steps, from, until: 0 } }),
      );
      const seen = (told.frames as unknown as Told[]).map((frame) => ({
        ...frame,
        state: frame.observation,
      }));
      this.frames = [...this.frames.slice(0, from), ...seen];
      this.steps = steps.slice(0, this.frames.length - 1);
      this.done = told.done;
      this.horizon = told.horizon;
      this.trouble = null;
      if (told.done) void this.#judge();
      return true;
    } catch (error) {
      this.trouble = error;
      return false;
    } finally {
      this.busy = false;
    }
  }

  /** What it is worth, and once it is over what came of it: for who may ask that, as viewers may not. */
  async #weigh() {
    this.worth = await this.#ask({ scenario: this.scenario });
  }

  async #judge() {
    const flown = this.steps;
    const actions = { steps: flown, precision: "f64" as const };
    const judged = await this.#ask({ scenario: this.scenario, actions });
    if (this.steps === flown) this.judged = judged; // else a step was taken back meanwhile
  }

  async #ask(wish: Schema["Wish"]): Promise<Schema["Checked"] | null> {
    for (let tries = 0; tries < TRIES; tries++) {
      try {
        return await body(client.POST("/v1/scenarios", { body: wish }));
      } catch (error) {
        const status = error instanceof Refused ? error.status : 0;
        if (status === 403) {
          this.unjudged = "only those who may train are told what a scenario is worth";
          return null;
        }
        if (status !== 503 && status !== 429) {
          this.trouble = error;
          return null;
        }
        await new Promise((wake) => setTimeout(wake, PAUSE_MS));
      }
    }
    this.unjudged = "the service has no time to work that out now";
    return null;
  }
}
