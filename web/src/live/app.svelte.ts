import { api, ApiError } from "../api/http";
import type { BoardOut, BoardsOut, EventOut, HealthOut, InfoOut } from "../api/wire";
import { sentenceOf } from "../logic/sentence";
import { recall, remember } from "../logic/storage";
import { Feeds } from "./feeds";
import { Stream, type Connection } from "./socket";

const EVENTS_KEPT = 200;
/** Messages with ages come twice a second: only one that is late lets them grow here. */
const MESSAGE_MS = 700;
/** How often ages on the screen move. */
const CLOCK_MS = 250;

/** The one reactive state of the page; drawing loops read the feeds directly. */
class App {
  connection = $state.raw<Connection>({ phase: "connecting", again: false });
  /** The service wants a token before it says anything. */
  doorClosed = $state(false);
  info = $state.raw<InfoOut | null>(null);
  boards = $state.raw<readonly BoardOut[]>([]);
  /** False until the boards are known. */
  known = $state(false);
  wantedId = $state(recall("board", ""));
  health = $state.raw<HealthOut | null>(null);
  events = $state.raw<readonly EventOut[]>([]);
  /** Host time in steps of a quarter second, ms: everything that ages reads this. */
  nowMs = $state(performance.now());

  private boardsMs = $state(0);
  private healthMs = $state(0);
  private readonly stream = new Stream((connection) => this.connected(connection));
  readonly feeds = new Feeds(this.stream);
  private leaveBoard: (() => void)[] = [];
  private watchedId = "";

  readonly board = $derived(this.boards.find((each) => each.id === this.wantedId) ?? this.boards[0] ?? null);
  readonly boardId = $derived(this.board?.id ?? "");
  /** Since the newest sample of the board arrived, s; null before the first. */
  readonly ageS = $derived(this.aged(this.board?.age_s, this.boardsMs));
  readonly linkLost = $derived(this.connection.phase !== "open");
  readonly canOperate = $derived(this.info?.role === "operator");
  readonly sentence = $derived(
    sentenceOf({
      connection: this.connection,
      nowMs: this.nowMs,
      known: this.known,
      board: this.board,
      ageS: this.ageS,
    }),
  );

  async start(): Promise<void> {
    setInterval(() => (this.nowMs = performance.now()), CLOCK_MS);
    this.stream.subscribe("boards", null, { data: (data) => this.gotBoards(data as BoardsOut) });
    await this.enter();
  }

  /** Ask who we are, then listen. */
  async enter(): Promise<void> {
    await this.askWho();
    if (!this.doorClosed) this.stream.retryNow();
  }

  /** A refusal shows the door; silence is left to the stream's retries. */
  private async askWho(): Promise<void> {
    try {
      this.info = await api.info();
      this.doorClosed = false;
    } catch (error) {
      if (!(error instanceof ApiError) || error.problem.status !== 401) return;
      this.doorClosed = true;
      this.stream.hold();
    }
  }

  async openDoor(token: string): Promise<void> {
    await api.openSession(token);
    await this.enter();
  }

  choose(boardId: string): void {
    this.wantedId = boardId;
    remember("board", boardId);
    this.watchBoard();
  }

  /** Receive a JSON topic until the returned function is called. */
  listen(topic: string, data: (data: unknown) => void): () => void {
    return this.stream.subscribe(topic, null, { data });
  }

  /** Age now of something the server called `ageS` old at the last message. */
  healthAge(ageS: number | null | undefined): number | null {
    return this.aged(ageS, this.healthMs);
  }

  boardAge(ageS: number | null | undefined): number | null {
    return this.aged(ageS, this.boardsMs);
  }

  private aged(ageS: number | null | undefined, receivedMs: number): number | null {
    if (ageS === null || ageS === undefined) return null;
    return ageS + Math.max(0, this.nowMs - receivedMs - MESSAGE_MS) / 1000;
  }

  private connected(connection: Connection): void {
    const reopened = connection.phase === "open" && this.connection.phase !== "open";
    this.connection = connection;
    // After a loss the token may have expired with a restart of the service, and the role may have changed.
    if (connection.phase === "waiting" || (reopened && !this.info)) void this.askWho();
  }

  private gotBoards(answer: BoardsOut): void {
    this.boards = answer.boards;
    this.known = true;
    this.boardsMs = this.nowMs = performance.now();
    this.watchBoard();
  }

  private watchBoard(): void {
    if (this.boardId === this.watchedId) return;
    for (const leave of this.leaveBoard) leave();
    this.watchedId = this.boardId;
    this.health = null;
    this.events = [];
    const topic = `boards/${this.boardId}`;
    this.leaveBoard = !this.boardId
      ? []
      : [
          this.stream.subscribe(`${topic}/health`, null, {
            data: (data) => this.gotHealth(data as HealthOut | null),
          }),
          this.stream.subscribe(`${topic}/events`, null, {
            data: (data) => this.addEvents([data as EventOut]),
          }),
        ];
  }

  private gotHealth(health: HealthOut | null): void {
    if (!health) return; // the board was removed this moment
    this.health = health;
    this.healthMs = performance.now();
    this.addEvents(health.events);
  }

  /** Newest last; an event is known by its number, so the health list and the topic may both bring it. */
  private addEvents(found: readonly EventOut[]): void {
    const held = new Set(this.events.map((event) => event.seq));
    const fresh = found.filter((event) => !held.has(event.seq));
    if (fresh.length === 0) return;
    this.events = [...this.events, ...fresh].sort((a, b) => a.seq - b.seq).slice(-EVENTS_KEPT);
  }
}

export const app = new App();
