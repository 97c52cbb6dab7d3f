/** Frames of a replay, as the service returns them, and predictions of close approaches. */
export interface Body {
  id: number;
  x: number;
  y: number;
  vx: number;
  vy: number;
}

export interface Satellite extends Body {
  fuel: number;
  status: string;
}

export interface KesslerState {
  satellites: Satellite[];
  radar_debris: Body[];
  radar_range: number;
  target_radius?: number | null;
  critical_alerts: string[];
  total_score: number;
}

export interface Deputy extends Body {
  z: number;
  vz: number;
  speed: number;
  speed_limit: number;
  distance: number;
  status: string;
}

export interface DockingState {
  deputies: Deputy[];
  docking_radius: number;
  critical_alerts: string[];
  total_score: number;
}

export interface Frame<S> {
  step: number;
  /** Actions of the step before this frame: [agent, value, …] each. */
  actions: number[][];
  reward: number;
  done: boolean;
  state: S;
}

export type KesslerFrame = Frame<KesslerState>;
export type DockingFrame = Frame<DockingState>;
export type AnyFrame = Frame<KesslerState | DockingState>;

export function isKessler(frames: AnyFrame[]): frames is KesslerFrame[] {
  const first = frames[0];
  return first !== undefined && "satellites" in first.state;
}

/** Closest approach of a satellite and a piece of debris if neither acts. */
export interface Approach {
  satellite: number;
  body: number;
  /** Steps until then. */
  steps: number;
  /** Distance in LU. */
  miss: number;
  /** Position of the satellite then. */
  x: number;
  y: number;
}

/** Gravitational parameter of the Earth, LU³/TU². */
const GM = 1000;
/** Radius of the Earth in LU. */
export const EARTH_RADIUS = 20;
/** Distance of two bodies below which they are in contact, in LU. */
export const CONTACT_DISTANCE = 2;

/** Propagates a body by one step, as the world does: semi-implicit Euler around a point mass. */
function propagate({ x, y, vx, vy }: Body | Satellite): Pick<Body, "x" | "y" | "vx" | "vy"> {
  const r = Math.hypot(x, y);
  const a = -GM / (r * r);
  const [ux, uy] = [vx + (a * x) / r, vy + (a * y) / r];
  return { x: x + ux, y: y + uy, vx: ux, vy: uy };
}

/** Predicts the positions of a body over the next steps, until it hits the Earth. */
export function predictPath(body: Body, steps: number): { x: number; y: number }[] {
  const positions = [{ x: body.x, y: body.y }];
  let state = body;
  for (let i = 0; i < steps && Math.hypot(state.x, state.y) >= EARTH_RADIUS; i++) {
    state = { ...state, ...propagate(state) };
    positions.push({ x: state.x, y: state.y });
  }
  return positions;
}

/** Returns the approaches closer than `near` in the next steps, nearest first. */
export function closestApproaches(state: KesslerState, steps: number, near: number): Approach[] {
  const debris = state.radar_debris.map((body) => ({ body, path: predictPath(body, steps) }));
  const approaches: Approach[] = [];
  for (const satellite of state.satellites.filter((satellite) => satellite.status === "active")) {
    const own = predictPath(satellite, steps);
    for (const { body, path } of debris) {
      let best: Approach | null = null;
      for (let i = 1; i < Math.min(own.length, path.length); i++) {
        const [a, b] = [own[i], path[i]];
        if (!a || !b) break;
        const miss = Math.hypot(a.x - b.x, a.y - b.y);
        if (best !== null && best.miss < CONTACT_DISTANCE) break; // contact: later positions are meaningless
        if (miss < near && (best === null || miss < best.miss))
          best = { satellite: satellite.id, body: body.id, steps: i, miss, x: a.x, y: a.y };
      }
      if (best) approaches.push(best);
    }
  }
  return approaches.sort((a, b) => a.miss - b.miss);
}
