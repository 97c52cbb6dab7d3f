/** Motion of a whole episode of tasking, from the samples of its frames, and values at any time of it. */
import type { MapObjects, SatelliteMotion, TaskingFrame } from "./frames";

/** Names of the samples that are numbers. */
type NumberName = Exclude<keyof SatelliteMotion, "view" | "station">;

/** Samples of one satellite over the whole episode. */
export interface SatelliteTrack extends SatelliteMotion {
  /** Action that the satellite executed at each sample; null before the first. */
  action: (string | null)[];
}

/** A step of an episode, between two times. */
export interface StepSpan {
  step: number;
  start: number;
  end: number;
  /** Action of each satellite; null before its first. */
  actions: (string | null)[];
}

/** An image of a target. */
export interface ImageEvent {
  time: number;
  satellite: number;
  target: number;
}

/** Motion and events of an episode, ordered by time. */
export interface EpisodeMotion {
  times: number[];
  sun: [number, number][];
  satellites: SatelliteTrack[];
  spans: StepSpan[];
  images: ImageEvent[];
  objects: MapObjects;
}

const NO_OBJECTS: MapObjects = {
  stations: [],
  target_longitudes: [],
  target_latitudes: [],
  target_priorities: [],
};

/** Joins the samples of all frames. */
export function joinMotion(frames: TaskingFrame[]): EpisodeMotion {
  const motion: EpisodeMotion = {
    times: [],
    sun: [],
    satellites: [],
    spans: [],
    images: [],
    objects: frames[0]?.state.map.objects ?? NO_OBJECTS,
  };
  let start = frames[0]?.state.time_s ?? 0;
  for (const [step, { state }] of frames.entries()) {
    const { map, satellites } = state;
    motion.times.push(...map.motion.time_s);
    motion.sun.push(...map.motion.sun);
    map.motion.satellites.forEach((samples, index) => {
      motion.satellites[index] ??= emptyTrack();
      append(motion.satellites[index], samples, satellites[index]?.action ?? null);
    });
    if (step > 0) {
      const actions = satellites.map(({ action }) => action);
      motion.spans.push({ step, start, end: state.time_s, actions });
    }
    for (const [satellite, target] of map.imaged)
      motion.images.push({ time: state.time_s, satellite, target });
    start = state.time_s;
  }
  return motion;
}

function emptyTrack(): SatelliteTrack {
  return {
    longitude: [],
    latitude: [],
    view: [],
    battery: [],
    storage: [],
    wheels: [],
    instrument_error: [],
    sun_error: [],
    sunlight: [],
    station: [],
    action: [],
  };
}

function append(track: SatelliteTrack, samples: SatelliteMotion, action: string | null) {
  const numbers: NumberName[] = [
    "longitude",
    "latitude",
    "battery",
    "storage",
    "wheels",
    "instrument_error",
    "sun_error",
    "sunlight",
  ];
  for (const name of numbers) track[name].push(...samples[name]);
  track.view.push(...samples.view);
  track.station.push(...samples.station);
  track.action.push(...samples.longitude.map(() => action));
}

/** Returns the index of the last sample at or before a time; 0 before the first. */
export function indexAt(times: number[], time: number): number {
  let [low, high] = [0, times.length - 1];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if ((times[middle] ?? Infinity) <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Returns longitude and latitude of a satellite at a time, on the short way between two samples. */
export function placeAt(motion: EpisodeMotion, satellite: number, time: number): [number, number] {
  const track = motion.satellites[satellite];
  const index = indexAt(motion.times, time);
  const [longitude, latitude] = [track?.longitude[index] ?? 0, track?.latitude[index] ?? 0];
  const [from, to] = [motion.times[index] ?? 0, motion.times[index + 1]];
  const [nextLongitude, nextLatitude] = [track?.longitude[index + 1], track?.latitude[index + 1]];
  if (to === undefined || nextLongitude === undefined || nextLatitude === undefined)
    return [longitude, latitude];
  const share = Math.min(1, Math.max(0, (time - from) / Math.max(to - from, 1e-9)));
  const turn = wrapLongitude(nextLongitude - longitude);
  return [wrapLongitude(longitude + share * turn), latitude + share * (nextLatitude - latitude)];
}

/** Returns a longitude between -180 and 180 degrees. */
export function wrapLongitude(degrees: number): number {
  return ((((degrees + 180) % 360) + 360) % 360) - 180;
}

/** Returns the time of a position in steps, which may have a fraction. */
export function timeAtStep(times: number[], at: number): number {
  const step = Math.min(Math.floor(at), times.length - 1);
  const from = times[step] ?? 0;
  const to = times[step + 1] ?? from;
  return from + (at - step) * (to - from);
}

/** Returns the position in steps of a time. */
export function stepAtTime(times: number[], time: number): number {
  const step = indexAt(times, time);
  const [from, to] = [times[step] ?? 0, times[step + 1]];
  if (to === undefined || to <= from) return step;
  return step + Math.min(1, Math.max(0, (time - from) / (to - from)));
}

/** Kind of an action: "image" for all images. */
export function actionKind(action: string | null): string {
  return action?.replace(/_\d+$/, "") ?? "none";
}
