/** Interval of an axis: of time in seconds, or of episodes, steps or versions. */
export interface Interval {
  from: number;
  to: number;
}

/** Interval that charts show and that the user selects on them. */
export interface AxisRange {
  readonly shown: Interval;
  select(from: number, to: number): void;
  showAll(): void;
}

/** Length of the shortest interval of time that can be selected, in seconds. */
const MIN_LENGTH_S = 1;
/** Length by which charts at least extend beyond the last data, in seconds. */
const MARGIN_S = 1;

/** Returns the end of the interval to show: `to` while data arrive, else shortly after the last data. */
export function endOfData({ from, to }: Interval, last: number | undefined): number {
  if (last === undefined || last <= from || to - last <= 0.1 * (to - from)) return to;
  return Math.min(to, last + Math.max(MARGIN_S, 0.03 * (last - from)));
}

/** Interval that all charts of a page show: of time by default. */
export class ShownRange implements AxisRange {
  /** Length of the shortest interval that can be selected. */
  readonly #minLength: number;

  constructor(minLength = MIN_LENGTH_S) {
    this.#minLength = minLength;
  }

  /** Interval with data. */
  available = $state<Interval>({ from: 0, to: 1 });
  /** Interval that the user selected; null shows all available data, which grow. */
  selected = $state<Interval | null>(null);

  get shown(): Interval {
    return this.selected ?? this.available;
  }

  /** Selects an interval, limited to the available one; ignores intervals that are too short. */
  select(from: number, to: number) {
    const start = Math.max(from, this.available.from);
    const end = Math.min(to, this.available.to);
    this.selected = end - start >= this.#minLength ? { from: start, to: end } : this.selected;
  }

  showAll() {
    this.selected = null;
  }

  /** Selects the last part of this length. */
  last(length: number) {
    this.select(this.available.to - length, this.available.to);
  }

  /** Scales the shown interval around its middle; factors below 1 zoom in. */
  zoom(factor: number) {
    const { from, to } = this.shown;
    const [middle, half] = [(from + to) / 2, ((to - from) * factor) / 2];
    if (2 * half >= this.available.to - this.available.from) this.showAll();
    else this.select(middle - half, middle + half);
  }

  /** Moves the shown interval by a share of its length. */
  pan(share: number) {
    const { from, to } = this.shown;
    const shift = Math.min(Math.max((to - from) * share, this.available.from - from), this.available.to - to);
    this.select(from + shift, to + shift);
  }
}
