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

/** A satellite of tasking, as agents observe it. */
export interface TaskedSatellite {
  id: number;
  alive: boolean;
  needs_action: boolean;
  /** Name of the last action. */
  action: string | null;
  battery: number;
  storage: number;
  wheels: number[];
  instrument_error_deg: number;
  sun_error_deg: number;
  targets: { priority: number; open_s: number; close_s: number; angle_deg: number }[];
}

/** Samples of a satellite's motion within a step; angles in degrees, resources as shares. */
export interface SatelliteMotion {
  longitude: number[];
  latitude: number[];
  /** Point that the instrument sees; null if it looks past the Earth. */
  view: ([number, number] | null)[];
  battery: number[];
  storage: number[];
  wheels: number[];
  instrument_error: number[];
  sun_error: number[];
  sunlight: number[];
  /** Number of a ground station that can be reached. */
  station: (number | null)[];
}

/** Ground stations and targets of a map. */
export interface MapObjects {
  stations: { name: string; longitude: number; latitude: number; radius: number }[];
  target_longitudes: number[];
  target_latitudes: number[];
  target_priorities: number[];
}

/** Map of an episode of tasking after a step. */
export interface TaskingMap {
  /** At the start only. */
  objects?: MapObjects;
  motion: { time_s: number[]; sun: [number, number][]; satellites: SatelliteMotion[] };
  /** Numbers of the next targets of each satellite. */
  upcoming: number[][];
  tasked: ({ target: number; open_s: number; close_s: number } | null)[];
  /** Images of the step as pairs of satellite and target. */
  imaged: [number, number][];
  links: [number, number][];
}

export interface TaskingState {
  time_s: number;
  time_limit_s: number;
  /** Names of the actions, by index. */
  actions: string[];
  satellites: TaskedSatellite[];
  critical_alerts: string[];
  total_score: number;
  map: TaskingMap;
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
export type TaskingFrame = Frame<TaskingState>;
export type AnyFrame = Frame<KesslerState | DockingState | TaskingState>;

export function isKessler(frames: AnyFrame[]): frames is KesslerFrame[] {
  const first = frames[0];
  return first !== undefined && "radar_debris" in first.state;
}

export function isTasking(frames: AnyFrame[]): frames is TaskingFrame[] {
  const first = frames[0];
  return first !== undefined && "map" in first.state;
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
