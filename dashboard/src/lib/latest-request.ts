/** Tracks the latest of several requests, so that responses to earlier ones can be dropped in whatever order they arrive. */
export class LatestRequest {
  #count = 0;

  /** Starts a request; the returned function is true as long as no later request has started. */
  begin(): () => boolean {
    this.#count += 1;
    const number = this.#count;
    return () => number === this.#count;
  }
}
