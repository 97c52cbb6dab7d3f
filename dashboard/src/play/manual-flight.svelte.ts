/** Episode that the user runs by hand: past steps and frames, the draft of the next action, and the results. */
import { ApiError, client, unwrap } from "../lib/api";
import type { ScenarioCheck, ScenarioRequest, TaskActionSpace } from "../lib/api-types";
import type { AnyFrame, DockingState, KesslerState, TaskingMap, TaskingState } from "../replay/frames";

/** Frame of the service with the observation of the agents. The player sees the observation instead of the full state. */
type ObservedFrame = AnyFrame & { observation: KesslerState | DockingState | Omit<TaskingState, "map"> };

/** Returns what the player sees: the observation, and in tasking the map, which hides nothing. */
function observedState({ observation, state }: ObservedFrame): AnyFrame["state"] {
  const map: TaskingMap | undefined = "map" in state ? state.map : undefined;
  return (map ? { ...observation, map } : observation) as AnyFrame["state"];
}

/** Fuel that a burn of 1 LU/TU costs in kessler. */
export const FUEL_PER_SPEED = 5;

export function isOutOfRange(value: number | undefined, { low, high }: TaskActionSpace): boolean {
  return value !== undefined && (value < low || value > high);
}

/** Maximum number of requests for a bracket, which a busy service rejects. */
const MAX_ATTEMPTS = 20;
/** Pause between these requests. */
const RETRY_MS = 1500;

/** State of a manual flight; the service simulates each step. */
export class ManualFlight {
  readonly scenario: Record<string, unknown>;
  /** Value of an action by which an agent holds. */
  readonly #hold: number;
  frames = $state.raw<AnyFrame[]>([]);
  steps = $state.raw<number[][][]>([]);
  done = $state(false);
  horizon = $state(0);
  /** Number of steps that were undone. */
  undoCount = $state(0);
  /** Values of each agent's action in the next step. */
  draft = $state<Record<number, number[]>>({});
  /** Check of the scenario with its bracket; null until it is computed. */
  check = $state<ScenarioCheck | null>(null);
  /** Check of the finished episode with its result; null until it is computed. */
  result = $state<ScenarioCheck | null>(null);
  /** Reason why the bracket or the result is unavailable; empty otherwise. */
  unavailable = $state("");
  busy = $state(false);
  error = $state<unknown>(null);

  constructor(scenario: Record<string, unknown>, { hold }: TaskActionSpace) {
    this.scenario = scenario;
    this.#hold = hold;
    void this.#simulate([], 0);
    // The bracket needs planning and arrives later than the first frame.
    void this.#loadCheck();
  }

  get lastFrame(): AnyFrame | undefined {
    return this.frames.at(-1);
  }

  /** The draft as an action of the API, without agents that hold. */
  get action(): number[][] {
    return Object.entries(this.draft)
      .filter(([, values]) => values.some((value) => value !== this.#hold))
      .map(([agent, values]) => [Number(agent), ...values]);
  }

  /** Takes `count` steps: with the draft in each of them if `repeat` is true, else in the first one only. */
  async commit(count: number, repeat: boolean) {
    const action = this.action;
    const length = Math.max(1, Math.min(Math.floor(count) || 1, this.horizon - this.steps.length));
    const added = Array.from({ length }, (_, i) => (repeat || i === 0 ? action : []));
    const before = this.steps.length;
    if (await this.#simulate([...this.steps, ...added], before + 1)) this.draft = {};
  }

  undo() {
    if (this.steps.length === 0) return;
    this.steps = this.steps.slice(0, -1);
    this.frames = this.frames.slice(0, -1);
    this.done = false;
    this.result = null;
    this.undoCount += 1;
  }

  /** Simulates these steps and loads the frames from step `from` on; returns true on success. */
  async #simulate(steps: number[][][], from: number): Promise<boolean> {
    if (this.busy) return false;
    this.busy = true;
    try {
      const flight = await unwrap(
        client.POST("/v1/rollouts", { body: { scenario: this.scenario, steps, from, until: 0 } }),
      );
      const observed = (flight.frames as unknown as ObservedFrame[]).map((frame) => ({
        ...frame,
        state: observedState(frame),
      }));
      this.frames = [...this.frames.slice(0, from), ...observed];
      this.steps = steps.slice(0, this.frames.length - 1);
      this.done = flight.done;
      this.horizon = flight.horizon;
      this.error = null;
      if (flight.done) void this.#loadResult();
      return true;
    } catch (error) {
      this.error = error;
      return false;
    } finally {
      this.busy = false;
    }
  }

  async #loadCheck() {
    this.check = await this.#checkScenario({ scenario: this.scenario });
  }

  async #loadResult() {
    const steps = this.steps;
    const actions = { steps, precision: "f64" as const };
    const result = await this.#checkScenario({ scenario: this.scenario, actions });
    if (this.steps === steps) this.result = result; // unless a step was undone meanwhile
  }

  /** Requests a check of the scenario; returns null if the user may not have it or the service stays busy. */
  async #checkScenario(request: ScenarioRequest): Promise<ScenarioCheck | null> {
    for (let attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
      try {
        return await unwrap(client.POST("/v1/scenarios", { body: request }));
      } catch (error) {
        const status = error instanceof ApiError ? error.status : 0;
        if (status === 403) {
          this.unavailable = "requires a token of the role trainer";
          return null;
        }
        if (status !== 503 && status !== 429) {
          this.error = error;
          return null;
        }
        await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
      }
    }
    this.unavailable = "not computed: the server is too busy";
    return null;
  }
}
