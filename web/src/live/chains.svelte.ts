import { api } from "../api/http";
import type { ChainOut, PreprocessingOut } from "../api/wire";
import { app } from "./app.svelte";

const POLL_MS = 3000;

/** What every sensor's preprocessing does on the board shown. */
class Chains {
  private held = $state.raw<PreprocessingOut | null>(null);
  readonly all = $derived<readonly ChainOut[]>(this.held?.board_id === app.boardId ? this.held.sensors : []);
  /** Those that do something, as a text: it changes only when they do. */
  readonly active = $derived(this.all.flatMap((each) => (each.active ? each.sensor : [])).join());

  /** Read now and then: others may change it, and its delay follows the rate; returns what ends it. */
  follow(): (() => void) | undefined {
    const { boardId } = app;
    if (!boardId) return undefined;
    const read = async (): Promise<void> => {
      const answer = document.hidden ? null : await api.chains(boardId).catch(() => null);
      if (answer && boardId === app.boardId) this.held = answer;
    };
    void read();
    const timer = setInterval(() => void read(), POLL_MS);
    return () => clearInterval(timer);
  }

  /** Throws what stands beside the field. */
  async set(sensor: string, name: string, value: number | null): Promise<void> {
    this.held = await api.setChain(app.boardId, sensor, { [name]: value });
  }
}

export const chains = new Chains();
