/**
 * What happens, as it happens: Server-Sent Events of a run, read by fetch so that a token can be sent with them. A connection that is lost
 * is tried again, from the last event that came; what is shown says that it is not live meanwhile.
 */
import { EventSourceParserStream } from "eventsource-parser/stream";
import { readable } from "./readable";
import { session } from "./session.svelte";

export interface Happened {
  id: number;
  kind: string;
  at: string;
  data: Record<string, unknown>;
}

export type Connection = "connecting" | "live" | "lost" | "refused";

const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 15_000;
/** The service says something at least so often, if only that it is there. */
const SILENCE_MS = 45_000;
/** So long nobody looks before it is left. */
const UNSEEN_MS = 60_000;

/** Waits until somebody looks, or it is over. */
async function seen(ended: AbortSignal) {
  await new Promise<void>((wake) => {
    const heard = new AbortController();
    const done = () => {
      if (document.hidden && !ended.aborted) return;
      heard.abort();
      wake();
    };
    document.addEventListener("visibilitychange", done, { signal: heard.signal });
    ended.addEventListener("abort", done, { signal: heard.signal });
    done();
  });
}

export class Live {
  state = $state<Connection>("connecting");
  #ended = new AbortController();
  #last: string | undefined;

  constructor(
    private readonly run: string,
    private readonly happened: (event: Happened) => void,
    private readonly again: () => void,
    /** Events of before that it begins with. */
    private readonly before: number,
  ) {
    void this.#follow();
  }

  end() {
    this.#ended.abort();
  }

  async #follow() {
    let pause = FIRST_PAUSE_MS;
    while (!this.#ended.signal.aborted) {
      try {
        await this.#listen(() => {
          if (this.state === "lost") this.again();
          this.state = "live";
          pause = FIRST_PAUSE_MS;
        });
      } catch {
        // Told by the state; why is the browser's business.
      }
      if (this.#ended.signal.aborted) return;
      this.state = "lost";
      if (document.hidden) await seen(this.#ended.signal);
      else await new Promise((wake) => setTimeout(wake, pause));
      pause = Math.min(2 * pause, LONGEST_PAUSE_MS);
    }
  }

  async #listen(open: () => void) {
    const silence = new AbortController();
    let timer = setTimeout(() => silence.abort(), SILENCE_MS);
    // Browsers open a few connections to a service and no more: pages that nobody looks at leave them to those that somebody does.
    let unseen: ReturnType<typeof setTimeout> | undefined;
    const look = () => {
      clearTimeout(unseen);
      unseen = document.hidden ? setTimeout(() => silence.abort(), UNSEEN_MS) : undefined;
    };
    document.addEventListener("visibilitychange", look);
    look();
    const headers: Record<string, string> = { Accept: "text/event-stream" };
    if (session.token) headers["Authorization"] = `Bearer ${session.token}`;
    if (this.#last !== undefined) headers["Last-Event-ID"] = this.#last;
    try {
      const answer = await fetch(
        `/v1/runs/${encodeURIComponent(this.run)}/events?last=${String(this.before)}`,
        {
          headers,
          signal: AbortSignal.any([this.#ended.signal, silence.signal]),
        },
      );
      if (answer.status === 401) session.needed = true;
      if (answer.status >= 400 && answer.status < 500 && answer.status !== 429) {
        this.state = "refused"; // why is said by what else was asked
        this.end();
        return;
      }
      if (!answer.ok || !answer.body) throw new Error(String(answer.status));
      open();
      const heard = new TransformStream<Uint8Array, Uint8Array>({
        transform(chunk, controller) {
          clearTimeout(timer);
          timer = setTimeout(() => silence.abort(), SILENCE_MS);
          controller.enqueue(chunk);
        },
      });
      const events = answer.body
        .pipeThrough(heard)
        .pipeThrough(new TextDecoderStream() as unknown as TransformStream<Uint8Array, string>)
        .pipeThrough(new EventSourceParserStream());
      const reader = events.getReader();
      for (let next = await reader.read(); !next.done; next = await reader.read()) this.#take(next.value);
    } finally {
      clearTimeout(timer);
      clearTimeout(unseen);
      document.removeEventListener("visibilitychange", look);
    }
  }

  #take(event: { id?: string | undefined; event?: string | undefined; data: string }) {
    if (event.id !== undefined) this.#last = event.id;
    const data = readable(JSON.parse(event.data) as Record<string, unknown>);
    this.happened({
      id: Number(event.id),
      kind: event.event ?? "message",
      at: String(data["at"] ?? ""),
      data,
    });
  }
}
