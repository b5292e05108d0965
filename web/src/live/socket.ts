import { apiUrl } from "../api/http";
import type { Problem } from "../api/wire";
import { isSilent, retryDelayS } from "./backoff";
import { decodeRows, type Rows } from "./rows";

/** What the page shows of its own connection to the service. */
export type Connection =
  | { readonly phase: "connecting"; readonly again: boolean }
  | { readonly phase: "open" }
  | { readonly phase: "waiting"; readonly untilMs: number };

export interface TopicHandlers {
  /** Rows of a binary topic. */
  rows?: (rows: Rows) => void;
  /** Body of a JSON topic. */
  data?: (data: unknown) => void;
  /** The subscription stands (again): columns of its rows, null for JSON. */
  subscribed?: (columns: readonly string[] | null) => void;
  /** The service refused the topic; the socket stays open. */
  refused?: (problem: Problem) => void;
}

interface Subscription {
  readonly id: number;
  readonly topic: string;
  readonly rateHz: number | null;
  readonly handlers: TopicHandlers;
}

interface ServerMessage {
  op: "subscribed" | "error" | "pong" | "tick" | "data";
  id?: number;
  columns?: string[] | null;
  problem?: Problem;
  data?: unknown;
}

const LAST_ID = 255;

/** The only WebSocket of the page: reconnects by itself, notices silence, renews its subscriptions. */
export class Stream {
  private socket: WebSocket | null = null;
  private readonly subscriptions = new Map<number, Subscription>();
  private attempt = 0;
  private alive = false;
  private held = false;
  private heardMs = 0;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private nextId = 1;
  private readonly onConnection: (connection: Connection) => void;

  constructor(onConnection: (connection: Connection) => void) {
    this.onConnection = onConnection;
    setInterval(() => this.watch(), 500);
    addEventListener("online", () => this.held || this.retryNow());
    document.addEventListener("visibilitychange", () => document.hidden || this.watch());
  }

  /** Stop trying until `retryNow`: the door is closed, knocking again is no use. */
  hold(): void {
    this.held = true;
    clearTimeout(this.retryTimer);
    this.socket?.close();
  }

  /** Open now, whatever was planned. */
  retryNow(): void {
    this.held = false;
    if (this.socket && this.socket.readyState <= WebSocket.OPEN) return;
    clearTimeout(this.retryTimer);
    this.open();
  }

  /** Receive a topic until the returned function is called; null = the topic's own rate. */
  subscribe(topic: string, rateHz: number | null, handlers: TopicHandlers): () => void {
    const subscription = { id: this.freeId(), topic, rateHz, handlers };
    this.subscriptions.set(subscription.id, subscription);
    this.request(subscription);
    return () => {
      if (!this.subscriptions.delete(subscription.id)) return;
      this.send({ op: "unsubscribe", id: subscription.id });
    };
  }

  private freeId(): number {
    for (let tries = 0; tries < LAST_ID; tries++) {
      const id = this.nextId;
      this.nextId = (this.nextId % LAST_ID) + 1;
      if (!this.subscriptions.has(id)) return id;
    }
    throw new Error("all 255 subscription ids are in use");
  }

  private request({ id, topic, rateHz }: Subscription): void {
    this.send({ op: "subscribe", id, topic, ...(rateHz === null ? {} : { rate_hz: rateHz }) });
  }

  private send(message: object): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  private open(): void {
    const url = apiUrl("stream");
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    this.onConnection({ phase: "connecting", again: this.attempt > 0 });
    const socket = new WebSocket(url, "navdeck.v1");
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.opened(socket);
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => this.received(event.data);
    socket.onclose = () => this.closed(socket);
    this.socket = socket;
    this.heardMs = performance.now();
  }

  private opened(socket: WebSocket): void {
    if (socket !== this.socket) return;
    this.heardMs = performance.now();
    for (const subscription of this.subscriptions.values()) this.request(subscription);
  }

  private closed(socket: WebSocket): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.alive = false;
    if (this.held) return;
    const delayMs = retryDelayS(this.attempt++) * 1000;
    this.onConnection({ phase: "waiting", untilMs: performance.now() + delayMs });
    this.retryTimer = setTimeout(() => this.open(), delayMs);
  }

  /** A socket that says nothing is dead, whatever the browser thinks; also one that never opens. */
  private watch(): void {
    const socket = this.socket;
    if (!socket || !isSilent(this.heardMs, performance.now())) return;
    socket.onclose = socket.onmessage = socket.onopen = null;
    socket.close();
    this.closed(socket);
  }

  private received(message: string | ArrayBuffer): void {
    this.heardMs = performance.now();
    if (!this.alive) this.onConnection({ phase: "open" }); // a socket that opens but says nothing is no connection
    this.alive = true;
    this.attempt = 0;
    if (typeof message === "string") this.receivedText(JSON.parse(message) as ServerMessage);
    else {
      const rows = decodeRows(message);
      if (rows) this.subscriptions.get(rows.id)?.handlers.rows?.(rows);
    }
  }

  private receivedText(message: ServerMessage): void {
    const handlers = this.subscriptions.get(message.id ?? 0)?.handlers;
    if (message.op === "data") handlers?.data?.(message.data);
    else if (message.op === "subscribed") handlers?.subscribed?.(message.columns ?? null);
    else if (message.op === "error" && message.problem) handlers?.refused?.(message.problem);
  }
}
