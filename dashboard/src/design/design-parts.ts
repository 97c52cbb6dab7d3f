/** Designs as the API returns them, as far as pictures show them; docs/reference/design-language.md defines the fields. */

/** Encounter of a satellite with debris. */
export interface DesignedEncounter {
  satellite: number;
  step: number;
  kind: "threat" | "decoy" | "screen";
  rogue: boolean;
}

/** Field of targets on the track of a satellite. */
export interface DesignedField {
  satellite: number;
  minute: number;
  /** Number of targets. */
  targets: number;
}

/** Parts of a design that its picture shows; lists are empty where a world has no such parts. */
export interface DesignParts {
  mode: string;
  /** Bearing of the aim in degrees; null without one. */
  aimBearing: number | null;
  /** True if bearings count from +X, false if they count from radial out. */
  isInertial: boolean;
  encounters: DesignedEncounter[];
  fields: DesignedField[];
}

type Json = Record<string, unknown>;

/** Reads the parts of a design; a field that is missing or invalid is left out. */
export function readDesignParts(design: unknown): DesignParts {
  const { aim, frame, encounters, fields } = objectOf(design);
  const { mode, bearing_deg } = objectOf(aim);
  return {
    mode: typeof mode === "string" ? mode : "",
    aimBearing: typeof bearing_deg === "number" ? bearing_deg : null,
    isInertial: frame === "inertial",
    encounters: listOf(encounters).map((encounter): DesignedEncounter => {
      const { satellite, step, kind, rogue } = encounter;
      return {
        satellite: numberOf(satellite),
        step: numberOf(step),
        kind: kind === "decoy" || kind === "screen" ? kind : "threat",
        rogue: rogue === true,
      };
    }),
    fields: listOf(fields).map(({ satellite, minute, targets }) => ({
      satellite: numberOf(satellite),
      minute: numberOf(minute),
      targets: numberOf(targets),
    })),
  };
}

function objectOf(value: unknown): Json {
  return typeof value === "object" && value !== null ? (value as Json) : {};
}

function listOf(value: unknown): Json[] {
  return Array.isArray(value) ? value.map(objectOf) : [];
}

function numberOf(value: unknown): number {
  return typeof value === "number" ? value : 0;
}

/** Reads the rogues of a scenario's layout, in the order of the encounters: step of the arrival and state before its motion. */
export function readRogues(scenario: unknown): [number, number, number, number, number][] {
  const { rogues } = objectOf(objectOf(objectOf(scenario)["layout"])["bodies"]);
  const rows: unknown[] = Array.isArray(rogues) ? rogues : [];
  return rows.filter(
    (row): row is [number, number, number, number, number] =>
      Array.isArray(row) && row.length === 5 && row.every((value) => typeof value === "number"),
  );
}
