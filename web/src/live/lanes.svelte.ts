import { api } from "../api/http";
import type { LaneChoiceOut, LaneOut, LanesOut } from "../api/wire";
import { runningLanes } from "../logic/lanes";
import { app } from "./app.svelte";

/** Events after which somebody, here or elsewhere, has changed what is known of the lanes. */
const CHANGES = new Set(["lanes-chosen", "lane-parameters-set", "lane-failed"]);

/** Every estimator there is of the board shown, and what may be changed of it; read by the places that show it. */
class Lanes {
  private held = $state.raw<LanesOut | null>(null);
  /** Counts what was asked and taken, so that an answer that was overtaken is dropped. */
  private turn = 0;
  /** Why they could not be read. */
  problem = $state.raw<unknown>(null);

  /** Null until the board shown has answered. */
  readonly answer = $derived(this.held?.board_id === app.boardId ? this.held : null);
  readonly all = $derived<readonly LaneChoiceOut[]>(this.answer?.lanes ?? []);
  readonly chosen = $derived<readonly string[]>(this.answer?.chosen ?? []);
  readonly running = $derived(runningLanes(this.all, this.chosen));
  readonly main = $derived(this.answer?.main_lane ?? app.board?.main_lane ?? "");
  /** Moves when something was changed by anybody. */
  private readonly lastChange = $derived(app.events.findLast((each) => CHANGES.has(each.code))?.seq ?? -1);

  /** Read, and read again when something has changed; for an effect of whoever shows them. */
  follow(): void {
    void this.lastChange;
    if (app.boardId && !app.linkLost) void this.read(app.boardId);
  }

  private async read(boardId: string): Promise<void> {
    const turn = ++this.turn;
    try {
      const answer = await api.lanes(boardId);
      if (turn === this.turn) this.take(answer);
    } catch (error) {
      if (turn === this.turn) this.problem = error;
    }
  }

  private take(answer: LanesOut): void {
    this.turn++;
    this.held = answer;
    this.problem = null;
  }

  async choose(names: readonly string[]): Promise<void> {
    this.take(await api.chooseLanes(app.boardId, names));
  }

  async set(lane: string, values: Readonly<Record<string, number | null>>): Promise<void> {
    this.take(await api.setParameters(app.boardId, lane, values));
  }

  /** What the health message says of it now; undefined while it says nothing. */
  live(lane: string): LaneOut | undefined {
    return app.health?.lanes.find((each) => each.lane === lane);
  }
}

export const lanes = new Lanes();
