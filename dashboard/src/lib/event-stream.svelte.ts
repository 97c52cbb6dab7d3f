/**
 * Event stream of a run: Server-Sent Events, read by fetch so that requests can carry a token. A lost connection is retried from the last
 * received event; `state` shows whether the stream is live.
 */
import { EventSourceParserStream } from "eventsource-parser/stream";
import { escapeControlCharacters } from "./control-characters";
import { session } from "./session.svelte";

export interface RunEvent {
  id: number;
  kind: string;
  /** Time of the event, ISO 8601. */
  at: string;
  data: Record<string, unknown>;
}

export type ConnectionState = "connecting" | "live" | "lost" | "refused";

const MIN_RETRY_MS = 500;
const MAX_RETRY_MS = 15_000;
/** Longest silence of a live stream: the service sends at least a comment in this time. */
const SILENCE_MS = 45_000;
/** Time after which the connection of a hidden page is closed. */
const HIDDEN_MS = 60_000;

/** Waits until the page is visible or the signal is aborted. */
async function untilVisible(closed: AbortSignal) {
  await new Promise<void>((resolve) => {
    const listeners = new AbortController();
    const check = () => {
      if (document.hidden && !closed.aborted) return;
      listeners.abort();
      resolve();
    };
    document.addEventListener("visibilitychange", check, { signal: listeners.signal });
    closed.addEventListener("abort", check, { signal: listeners.signal });
    check();
  });
}

export class EventStream {
  state = $state<ConnectionState>("connecting");
  #closed = new AbortController();
  #lastId: string | undefined;

  constructor(
    private readonly run: string,
    private readonly onEvent: (event: RunEvent) => void,
    /** Called when a lost connection is live again. */
    private readonly onReconnect: () => void,
    /** Number of past events that the stream starts with. */
    private readonly initialEvents: number,
    /** Kinds of the events, separated by commas; all of them by default. */
    private readonly kinds = "",
  ) {
    void this.#connectUntilClosed();
  }

  close() {
    this.#closed.abort();
  }

  async #connectUntilClosed() {
    let retryMs = MIN_RETRY_MS;
    while (!this.#closed.signal.aborted) {
      try {
        await this.#read(() => {
          if (this.state === "lost") this.onReconnect();
          this.state = "live";
          retryMs = MIN_RETRY_MS;
        });
      } catch {
        // The state shows the failure; the browser logs its cause.
      }
      if (this.#closed.signal.aborted) return;
      this.state = "lost";
      if (document.hidden) await untilVisible(this.#closed.signal);
      else await new Promise((resolve) => setTimeout(resolve, retryMs));
      retryMs = Math.min(2 * retryMs, MAX_RETRY_MS);
    }
  }

  /** Connects and reads events until the connection ends. */
  async #read(onOpen: () => void) {
    const timeout = new AbortController();
    let silenceTimer = setTimeout(() => timeout.abort(), SILENCE_MS);
    // Browsers limit the connections to one service, so that hidden pages leave theirs to visible ones.
    let hiddenTimer: ReturnType<typeof setTimeout> | undefined;
    const onVisibilityChange = () => {
      clearTimeout(hiddenTimer);
      hiddenTimer = document.hidden ? setTimeout(() => timeout.abort(), HIDDEN_MS) : undefined;
    };
    document.addEventListener("visibilitychange", onVisibilityChange);
    onVisibilityChange();
    const headers: Record<string, string> = { Accept: "text/event-stream" };
    const token = session.token;
    if (token) headers["Authorization"] = `Bearer ${token}`;
    if (this.#lastId !== undefined) headers["Last-Event-ID"] = this.#lastId;
    const kinds = this.kinds ? `&kind=${encodeURIComponent(this.kinds)}` : "";
    try {
      const response = await fetch(
        `/v1/runs/${encodeURIComponent(this.run)}/events?last=${String(this.initialEvents)}${kinds}`,
        {
          headers,
          signal: AbortSignal.any([this.#closed.signal, timeout.signal]),
        },
      );
      if (response.status === 401) session.reject(token);
      if (response.status >= 400 && response.status < 500 && response.status !== 429) {
        this.state = "refused"; // the other requests of the page report the reason
        this.close();
        return;
      }
      if (!response.ok || !response.body) throw new Error(String(response.status));
      onOpen();
      const resetSilenceTimer = new TransformStream<Uint8Array, Uint8Array>({
        transform(chunk, controller) {
          clearTimeout(silenceTimer);
          silenceTimer = setTimeout(() => timeout.abort(), SILENCE_MS);
          controller.enqueue(chunk);
        },
      });
      const events = response.body
        .pipeThrough(resetSilenceTimer)
        .pipeThrough(new TextDecoderStream() as unknown as TransformStream<Uint8Array, string>)
        .pipeThrough(new EventSourceParserStream());
      const reader = events.getReader();
      for (let next = await reader.read(); !next.done; next = await reader.read()) this.#emit(next.value);
    } finally {
      clearTimeout(silenceTimer);
      clearTimeout(hiddenTimer);
      document.removeEventListener("visibilitychange", onVisibilityChange);
    }
  }

  #emit(event: { id?: string | undefined; event?: string | undefined; data: string }) {
    if (event.id !== undefined) this.#lastId = event.id;
    const data = escapeControlCharacters(JSON.parse(event.data) as Record<string, unknown>);
    this.onEvent({
      id: Number(event.id),
      kind: event.event ?? "message",
      at: String(data["at"] ?? ""),
      data,
    });
  }
}
