/** Frames of a replay, as the service tells them. */
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
  /** What was done to come here: [agent, value, …] each. */
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

/** Where two bodies will be nearest if nobody acts on either: by their present motion, within so many steps. */
export interface Approach {
  satellite: number;
  body: number;
  steps: number;
  miss: number;
  x: number;
  y: number;
}

const GM = 1000;
const EARTH = 20;
/** Bodies that come nearer have hit. */
export const CONTACT = 2;

/** One step of motion, as the world makes it: semi-implicit Euler around a point mass. */
function moved({ x, y, vx, vy }: Body | Satellite): Pick<Body, "x" | "y" | "vx" | "vy"> {
  const r = Math.hypot(x, y);
  const a = -GM / (r * r);
  const [ux, uy] = [vx + (a * x) / r, vy + (a * y) / r];
  return { x: x + ux, y: y + uy, vx: ux, vy: uy };
}

/** Paths of a body over the coming steps, until it meets the Earth. */
export function path(body: Body, steps: number): { x: number; y: number }[] {
  const places = [{ x: body.x, y: body.y }];
  let at = body;
  for (let i = 0; i < steps && Math.hypot(at.x, at.y) >= EARTH; i++) {
    at = { ...at, ...moved(at) };
    places.push({ x: at.x, y: at.y });
  }
  return places;
}

/** The closest approaches below `near` in the coming steps, the nearest first. */
export function approaches(state: KesslerState, steps: number, near: number): Approach[] {
  const debris = state.radar_debris.map((body) => ({ body, places: path(body, steps) }));
  const found: Approach[] = [];
  for (const satellite of state.satellites.filter((satellite) => satellite.status === "active")) {
    const own = path(satellite, steps);
    for (const { body, places } of debris) {
      let best: Approach | null = null;
      for (let i = 1; i < Math.min(own.length, places.length); i++) {
        const [a, b] = [own[i], places[i]];
        if (!a || !b) break;
        const miss = Math.hypot(a.x - b.x, a.y - b.y);
        if (best !== null && best.miss < CONTACT) break; // they have met: what would come after does not come
        if (miss < near && (best === null || miss < best.miss))
          best = { satellite: satellite.id, body: body.id, steps: i, miss, x: a.x, y: a.y };
      }
      if (best) found.push(best);
    }
  }
  return found.sort((a, b) => a.miss - b.miss);
}
