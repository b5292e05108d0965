import { api } from "../api/http";
import type { JobOut, JobsOut, SetsOut } from "../api/wire";
import { app } from "./app.svelte";

/** Calibration jobs and stored sets of the board shown. They live on the service: here is only what it last said. */
class Calibration {
  private heldJobs = $state.raw<JobsOut | null>(null);
  private heldSets = $state.raw<SetsOut | null>(null);
  private turn = 0;
  /** Why the store could not be read. */
  problem = $state.raw<unknown>(null);

  /** False until the board's jobs are known. */
  readonly known = $derived(this.heldJobs?.board_id === app.boardId);
  readonly jobs = $derived<readonly JobOut[]>(this.known ? (this.heldJobs?.jobs ?? []) : []);
  readonly sets = $derived(this.heldSets?.board_id === app.boardId ? this.heldSets : null);
  /** Moves when what is in force may have changed. */
  private readonly lastChange = $derived(
    `${app.events.findLast((each) => each.code.startsWith("calibration"))?.seq} ${this.jobs.map((job) => job.set_id).join()}`,
  );

  /** Listen to the jobs of the board shown; returns what ends it, for an effect of whoever shows them. */
  followJobs(): (() => void) | undefined {
    const { boardId } = app;
    if (!boardId) return undefined;
    return app.listen(`boards/${boardId}/calibration`, (data) => (this.heldJobs = data as JobsOut | null));
  }

  /** Read the store, and again when it may have changed; for an effect likewise. */
  followSets(): void {
    void this.lastChange;
    if (app.boardId && !app.linkLost) void this.readSets();
  }

  async readSets(): Promise<void> {
    const turn = ++this.turn;
    try {
      const answer = await api.calibrationSets(app.boardId);
      if (turn === this.turn) this.takeSets(answer);
    } catch (error) {
      if (turn === this.turn) this.problem = error;
    }
  }

  takeSets(answer: SetsOut): void {
    this.turn++;
    this.heldSets = answer;
    this.problem = null;
  }

  /** An answer is newer than the last message. */
  takeJob(job: JobOut): void {
    const others = this.jobs.filter((each) => each.id !== job.id);
    const isNew = others.length === this.jobs.length;
    const jobs = isNew ? [job, ...others] : this.jobs.map((each) => (each.id === job.id ? job : each));
    this.heldJobs = { board_id: job.board_id, jobs };
  }
}

export const calibration = new Calibration();
