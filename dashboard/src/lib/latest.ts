/** Of several questions that were asked one after the other, only the last one's answer is shown, whichever comes last. */
export class Latest {
  #asked = 0;

  /** Asks anew: what is answered says whether nothing was asked since. */
  ask(): () => boolean {
    this.#asked += 1;
    const mine = this.#asked;
    return () => mine === this.#asked;
  }
}
