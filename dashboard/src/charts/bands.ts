/** A stretch of speeds that failures are counted by. */
export interface Band {
  band: number;
  from: number;
  to?: number | null;
  unit: string;
}

/** 0.5 to 1 LU/TU, or 2 LU/TU and more. */
export function speeds({ from, to, unit }: Band): string {
  return to === null || to === undefined
    ? `${String(from)} ${unit} and more`
    : `${String(from)} to ${String(to)} ${unit}`;
}
