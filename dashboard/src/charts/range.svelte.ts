/** The stretch of time that all charts of a page show. */
export interface Stretch {
  from: number;
  to: number;
}

const SHORTEST_S = 60;

/** Where what there is to see ends: at `to` while data come, else a little after the last of them. */
export function endOf({ from, to }: Stretch, last: number | undefined): number {
  if (last === undefined || last <= from || to - last <= 0.1 * (to - from)) return to;
  return Math.min(to, last + Math.max(SHORTEST_S, 0.03 * (last - from)));
}

export class TimeRange {
  /** What there is to see, seconds since 1970. */
  whole = $state<Stretch>({ from: 0, to: 1 });
  /** What was chosen; none is all there is, which grows. */
  chosen = $state<Stretch | null>(null);

  get shown(): Stretch {
    return this.chosen ?? this.whole;
  }

  choose(from: number, to: number) {
    const least = Math.max(from, this.whole.from);
    const most = Math.min(to, this.whole.to);
    this.chosen = most - least >= SHORTEST_S ? { from: least, to: most } : this.chosen;
  }

  all() {
    this.chosen = null;
  }

  /** The last so many seconds. */
  last(seconds: number) {
    this.choose(this.whole.to - seconds, this.whole.to);
  }

  /** Nearer (below 1) or farther, around the middle. */
  zoom(factor: number) {
    const { from, to } = this.shown;
    const [middle, half] = [(from + to) / 2, ((to - from) * factor) / 2];
    if (2 * half >= this.whole.to - this.whole.from) this.all();
    else this.choose(middle - half, middle + half);
  }

  /** Along, by a share of what is shown. */
  pan(share: number) {
    const { from, to } = this.shown;
    const by = Math.min(Math.max((to - from) * share, this.whole.from - from), this.whole.to - to);
    this.choose(from + by, to + by);
  }
}
